"""When success counts as confirmed by what the camera sees."""

from __future__ import annotations

import pytest

from dore.sim.vision.scene_estimate import Detection, Observation, unconfirmed
from dore.world.problem import Scene
from tests.setups import LAYOUT


@pytest.mark.parametrize(
    ("cells_xy", "fine"),
    [
        ([(0, 0), (8, 0)], True),
        ([(0, 0)], False),
        ([(0, 0), (7, 0)], False),
        ([(0, 0.12), (8, 0)], False),  # the first one off the board, beside its cell
        ([(0, 0), (8, 0), (3, 0)], False),
        ([(0, 0), (8, 0), (8, 0.02)], False),  # two on one cell
    ],
)
def test_confirmation_wants_every_obstacle_where_it_stood(cells_xy, fine):
    before = Scene(LAYOUT, obstacles=(0, 8), target=14)
    seen = [
        Detection((LAYOUT.cells[cell][0], LAYOUT.cells[cell][1] + aside), 0.025, 0.15, 0.0, "cylinder", True, False)
        for cell, aside in cells_xy
    ]
    assert (unconfirmed(Observation(tuple(seen)), before) is None) == fine


def test_a_target_still_on_the_board_is_not_confirmed():
    before = Scene(LAYOUT, obstacles=(), target=14)
    held_in_front, standing = ((LAYOUT.front_m - 0.05, 0.0), LAYOUT.cells[14])
    for xy, says in ((held_in_front, None), (standing, "the target still stands on the board")):
        one = Detection(xy, 0.025, 0.15, 0.0, "cylinder", True, True)
        assert unconfirmed(Observation((one,)), before) == says


def test_a_board_that_is_not_all_measured_is_not_confirmed():
    before = Scene(LAYOUT, obstacles=(), target=14)
    assert unconfirmed(Observation((), frozenset({2, 7})), before) == "cells 3 and 8 are not measured"
