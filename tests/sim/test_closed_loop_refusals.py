"""Closed loops that stop with a named refusal, and never with a false claim."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
import sapien

from dore.errors import InputError
from dore.sim.motion.outcome import Outcome
from dore.sim.run import closed_loop
from dore.sim.run.closed_loop import Limits
from dore.sim.run.disturbances import IntruderObject, Nothing, ObjectMoved, SlippingGrasp
from dore.sim.run.execution import run_loop
from dore.sim.run.feedback import positions
from dore.sim.vision.camera import RgbdCamera
from dore.world.problem import Scene
from tests.setups import LAYOUT
from tests.sim.closed_loops import FULL, SETUP, carry_out, kinds, loop_with

pytestmark = pytest.mark.sim


def test_a_grasp_that_always_slips_ends_in_a_named_refusal(monkeypatch, tmp_path):
    class Slippery(SlippingGrasp):
        def grip(self, world, command):
            self.grasps_left = 1
            return super().grip(world, command)

    report = carry_out(monkeypatch, tmp_path, loop_with(Slippery(at_grasp=1)))
    assert not report.claimed
    assert report.outcome is Outcome.GAVE_UP
    assert "3 faults, limits.max_faults" in report.message
    assert len(report.moves) == 3


def test_the_target_taken_out_of_the_hand_is_never_claimed(monkeypatch, tmp_path):
    def thief(env):
        world = env.unwrapped
        if positions(world)[0, 0] < LAYOUT.front_m - 0.05:
            world.objects[0].set_pose(sapien.Pose(p=[1.5, 0.0, -1.0]))

    report = carry_out(monkeypatch, tmp_path, loop_with(Nothing()), each_step=thief)
    assert not report.claimed
    assert not report.success
    assert report.outcome is Outcome.NOT_UNDERSTOOD
    assert "no target" in report.message


def test_an_obstacle_lost_off_the_table_is_missed(monkeypatch, tmp_path):
    """Dropped before the grid, where no camera looks."""

    def thief(env):
        world = env.unwrapped
        for index in (1, 2, 3):
            if positions(world)[index, 0] < LAYOUT.front_m - 0.03:
                world.objects[index].set_pose(sapien.Pose(p=[0.2, 0.6, -0.5]))

    report = carry_out(monkeypatch, tmp_path, loop_with(Nothing()), each_step=thief)
    assert report.outcome is Outcome.MISSING
    assert "4 objects were seen, and now 3" in report.message
    assert not report.claimed
    assert not report.refused


@pytest.mark.parametrize(
    ("to", "says"),
    [
        ([0.66, 0.44, 0.075], r"outside every cell"),
        ([0.56, 0.30, 0.03], r"upright"),
        ([0.66, -0.30, 0.075], r"two objects|both"),
    ],
)
def test_a_scene_that_is_no_board_is_refused_by_name(monkeypatch, tmp_path, to, says):
    """Off the board, lying down, and two in a cell."""
    lying = [0.5**0.5, 0.5**0.5, 0, 0] if to[2] < 0.05 else [1, 0, 0, 0]

    class Meddler(Nothing):
        def between_moves(self, world, moves, rng):
            world.objects[1].set_pose(sapien.Pose(p=to, q=lying))
            return None

    scene = Scene(LAYOUT, obstacles=(2, 11), target=14)
    report = carry_out(monkeypatch, tmp_path, loop_with(Meddler(), scene))
    assert report.outcome is Outcome.NOT_UNDERSTOOD
    assert report.moves == []
    assert report.refused
    assert kinds(report) == ["look", "look", "refusal"]
    assert re.search(says, report.message), report.message


def test_no_plan_is_said_with_the_planner_s_reason(monkeypatch, tmp_path):
    report = carry_out(monkeypatch, tmp_path, loop_with(Nothing(), FULL))
    assert report.outcome is Outcome.NO_PLAN
    assert "refused: exact: unsolvable" in report.message
    assert report.refused


def test_limits_and_disturbances_check_their_domain():
    with pytest.raises(InputError, match=r"limits\.max_moves"):
        Limits(0, 1, 1)
    with pytest.raises(InputError, match=r"disturbance\.at_grasp"):
        SlippingGrasp(0)
    with pytest.raises(InputError, match=r"disturbance\.after_moves"):
        ObjectMoved(-1)


def test_without_a_camera_there_is_no_closed_loop(monkeypatch, tmp_path):
    monkeypatch.setattr(closed_loop, "render_backend", lambda: "none")
    with pytest.raises(InputError, match="closed needs a camera: no Vulkan driver here"):
        run_loop(loop_with(Nothing(), sensor=RgbdCamera), SETUP, tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_what_the_camera_cannot_see_is_bad_input_before_anything_is_made(tmp_path):
    low = replace(SETUP, camera=replace(SETUP.camera, position_m=(0.4, 0.0, 0.3)))
    with pytest.raises(InputError, match=r"camera\.position_m"):
        run_loop(loop_with(Nothing()), low, tmp_path / "none")
    with pytest.raises(InputError, match="disturbance: puts in 1 more, and the scene has 0 cells left"):
        run_loop(loop_with(IntruderObject(1), FULL), SETUP, tmp_path / "none")
    assert not (tmp_path / "none").exists()
