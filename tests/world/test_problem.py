"""A scene and a reach make a problem only on one layout; a batch of it holds the scene's cells."""

from __future__ import annotations

import json
from dataclasses import FrozenInstanceError

import pytest
import torch

from dore.errors import InputError
from dore.world.board import unpack
from dore.world.layout import Layout
from dore.world.problem import Batch, Problem, Scene
from dore.world.reach import Reach


def reach_on(layout: Layout) -> Reach:
    return Reach(layout, clearance_m=0.142, half_fan_deg=15.0, n_sectors=30)


@pytest.mark.parametrize(
    "other",
    [
        Layout.grid(3, 6, 0.12, front_m=0.40),
        Layout.grid(6, 3, 0.12),
        Layout.grid(3, 6, 0.13, front_m=0.57),
        Layout(tuple(reversed(Layout.grid(3, 6, 0.12).cells)), 0.12),
    ],
)
def test_a_scene_and_a_reach_of_different_layouts_are_refused(other: Layout) -> None:
    scene = Scene(Layout.grid(3, 6, 0.12), (3, 9), 15)
    with pytest.raises(InputError, match=r"^scene\.layout: got 18 cells|^scene\.layout: got 3 x 6") as refusal:
        Problem(scene, reach_on(other))
    assert "\n" not in str(refusal.value)


def test_the_message_names_both_layouts() -> None:
    scene = Scene(Layout.grid(3, 6, 0.12, front_m=0.57), (3, 9), 15)
    wanted = (
        r"^scene\.layout: got 3 x 6 cells of 0\.12 m from x = 0\.57 m, "
        r"want the reach's layout, 3 x 6 cells of 0\.12 m from x = 0\.4 m$"
    )
    with pytest.raises(InputError, match=wanted):
        Problem(scene, reach_on(Layout.grid(3, 6, 0.12, front_m=0.40)))


@pytest.mark.parametrize("cell_m", [0.07, 0.12, 0.1234567])
def test_a_layout_that_went_through_a_file_is_still_the_same(cell_m: float) -> None:
    layout = Layout.grid(5, 7, cell_m)
    back = Layout.from_dict(json.loads(json.dumps(layout.to_dict())))
    assert Problem(Scene(back, (3,), 4), reach_on(layout)).scene.layout is back


def test_a_problem_is_frozen() -> None:
    layout = Layout.grid(3, 6, 0.12)
    problem = Problem(Scene(layout, (3,), 15), reach_on(layout))
    with pytest.raises(FrozenInstanceError):
        problem.reach = reach_on(Layout.grid(3, 6, 0.12, front_m=0.40))  # type: ignore[misc]


def test_a_problem_as_a_batch() -> None:
    layout = Layout.grid(10, 10, 0.12)
    board, target = Batch.of(Problem(Scene(layout, (0, 63, 64, 99), 50), reach_on(layout)))
    assert board.shape == (1, 2)
    assert unpack(board, 100)[0].nonzero().squeeze(-1).tolist() == [0, 63, 64, 99]
    assert torch.equal(target, torch.tensor([50]))


def test_an_array_without_dimensions_is_no_list_of_cells() -> None:
    with pytest.raises(InputError, match=r"scene\.obstacles"):
        Scene(Layout.grid(3, 3, 0.09), torch.tensor(1), 3)  # type: ignore[arg-type]
