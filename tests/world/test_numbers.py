"""Numbers and arrays of NumPy and torch at the Python API: taken and widened, or refused in one line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from dore.errors import InputError, number, whole
from dore.world.files import read_plan, write_plan
from dore.world.layout import Layout
from dore.world.plan import Move, Plan, PlanFile, Status
from dore.world.problem import Problem, Scene
from tests.world.test_plan import FIG_7, FIG_7_PLAN, REACH

LAYOUT = Layout.grid(3, 6, 0.12)


@pytest.mark.parametrize(
    "three", [3, np.int64(3), np.int8(3), np.uint16(3), torch.tensor(3), torch.tensor([3]).short()[0]]
)
def test_integers(three: object) -> None:
    found = whole("rows", three, 1)
    assert found == 3
    assert type(found) is int


@pytest.mark.parametrize(
    "bad", [2.5, 3.0, np.float64(3), np.bool_(True), torch.tensor(True), "3", None, [3], np.array([3, 4])]
)
def test_what_is_no_integer(bad: object) -> None:
    with pytest.raises(InputError, match=r"^rows: got [^\n]*, want a whole number of 1 or more$"):
        whole("rows", bad, 1)


@pytest.mark.parametrize(
    "half", [0.5, np.float32(0.5), np.float64(0.5), torch.tensor(0.5), torch.tensor(0.5).bfloat16()]
)
def test_numbers(half: object) -> None:
    found = number("x", half)
    assert found == 0.5
    assert type(found) is float


@pytest.mark.parametrize(
    "bad", [float("nan"), np.inf, 10**400, "0.5", None, True, np.bool_(False), [0.5], np.array([1.0, 2.0])]
)
def test_what_is_no_number(bad: object) -> None:
    with pytest.raises(InputError, match=r"^x: got [^\n]*, want a finite number$"):
        number("x", bad)


def test_a_scene_may_be_made_of_arrays() -> None:
    for obstacles in (np.flatnonzero(np.arange(18) % 5 == 0), torch.tensor([0, 5, 10, 15]), [0, 5, 10, 15]):
        scene = Scene(LAYOUT, obstacles, np.int64(14))  # type: ignore[arg-type]
        assert scene == Scene(LAYOUT, (0, 5, 10, 15), 14)
        assert {type(cell) for cell in (*scene.obstacles, scene.target)} == {int}


def test_scenes_of_the_same_objects_are_equal() -> None:
    assert Scene(LAYOUT, (15, 0, 5), 14) == Scene(LAYOUT, [0, 5, 15], 14)  # type: ignore[arg-type]
    assert hash(Scene(LAYOUT, (15, 0, 5), 14)) == hash(Scene(LAYOUT, (0, 5, 15), 14))


@pytest.mark.parametrize(
    ("obstacles", "target", "says"),
    [
        (b"12", 14, "scene.obstacles: got b'12', want a list of cells"),
        ({1: 2}, 14, "scene.obstacles: got {1: 2}, want a list of cells"),
        ((2.5,), 14, "scene.obstacles: got 2.5, want a whole number"),
        ((2,), 14.0, "scene.target: got 14.0, want a whole number"),
        (np.array([1.0]), 14, "scene.obstacles: got .*1.0.*, want a whole number"),
        (5, 14, "scene.obstacles: got 5, want a list of cells"),
        ((np.int64(18),), 14, "scene.obstacles: id 19, want 1 to 18"),
    ],
)
def test_other_cells_are_refused(obstacles: object, target: object, says: str) -> None:
    with pytest.raises(InputError, match=says):
        Scene(LAYOUT, obstacles, target)  # type: ignore[arg-type]


def test_a_layout_of_arrays() -> None:
    assert Layout(np.array([[0.5, 0.0], [0.6, 0.0]]), np.float64(0.1)) == Layout(((0.5, 0.0), (0.6, 0.0)), 0.1)  # type: ignore[arg-type]
    assert Layout([[0.5, 0.0], [0.6, 0.0]], 0.1) == Layout(((0.5, 0.0), (0.6, 0.0)), 0.1)  # type: ignore[arg-type]
    assert Layout.grid(np.int64(3), np.int32(6), np.float64(0.12)) == LAYOUT  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"layout.cells: got \[0.5, 0.6\], want a list of \[x, y\] in metres"):
        Layout([0.5, 0.6], 0.1)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("status", "solved", "plan.status: got 'solved', want a Status"),
        ("moves", [(1, 2)], r"plan.moves: got \[\(1, 2\)\], want a tuple of Move"),
        ("planner", None, "plan.planner: got None, want text"),
        ("planning_s", float("nan"), "plan.planning_s: got nan, want a finite number"),
        ("planning_s", "1", "plan.planning_s: got '1', want a finite number"),
        ("expansions", 2.5, "plan.expansions: got 2.5, want a whole number of 0 or more"),
        ("optimal_moves", -1, "plan.optimal_moves: got -1, want a whole number of 0 or more"),
    ],
)
def test_a_plan_holds_no_loose_types(field: str, value: object, says: str) -> None:
    with pytest.raises(InputError, match=f"^{says}"):
        replace(FIG_7_PLAN, **{field: value})  # type: ignore[arg-type]
    plan = replace(FIG_7_PLAN, planning_s=np.float32(0.5), expansions=torch.tensor(3))  # type: ignore[arg-type]
    assert (type(plan.planning_s), type(plan.expansions)) == (float, int)


def test_a_plan_of_numpy_numbers_is_written(tmp_path: Path) -> None:
    moves = tuple(
        Move(np.int64(move.pick), np.int32(move.place), np.float64(move.pick_direction_deg), move.place_direction_deg)
        for move in FIG_7_PLAN.moves
    )
    plan = Plan(Status.SOLVED, moves, FIG_7_PLAN.target_direction_deg, "test", 0.0)
    write_plan(tmp_path / "plan.json", PlanFile(Problem(FIG_7, REACH), plan))
    assert read_plan(tmp_path / "plan.json").plan.moves == FIG_7_PLAN.moves
    with pytest.raises(InputError, match=r"plan.moves.pick: got 1.5, want a whole number"):
        Move(1.5, 2, 0.0, 0.0)  # type: ignore[arg-type]
