"""Closed loops: the unexpected leads to looking and planning again, or to a refusal; never to a false claim.

The simulator's state stands in for the camera, so that these run where nothing can render; test_camera.py
tests the camera itself.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sapien
import torch

from dore.app.build import reach_of
from dore.errors import InputError
from dore.planners.exact import Exact
from dore.sim.config import preset
from dore.sim.motion.outcome import Outcome
from dore.sim.run import closed_loop
from dore.sim.run.closed_loop import ClosedLoop, Limits
from dore.sim.run.disturbances import IntruderObject, Nothing, ObjectMoved, SlippingGrasp
from dore.sim.run.execution import execute
from dore.sim.run.feedback import leaning_deg, positions
from dore.sim.run.operator import Operator
from dore.sim.run.report import ExecutionReport
from dore.sim.run.setup import Setup
from dore.sim.vision.camera import RgbdCamera
from dore.sim.vision.scene_estimate import Detection, Observation
from dore.world.layout import Layout
from dore.world.problem import Batch, Problem, Scene
from tests.app.test_conf import compose

pytestmark = pytest.mark.sim

LAYOUT = Layout.grid(3, 6, 0.12, 0.50)
SCENE = Scene(LAYOUT, obstacles=(2, 8, 13), target=14)
LIMITS = Limits(max_moves=8, max_faults=2, max_looks=2)
SETUP = Setup(
    preset("arm/panda_slim"),
    preset("objects/mixed"),
    preset("view/corner"),
    preset("camera/kinect"),
    seed=3,
    film=False,
)


class TrueCamera:
    """Sees what the camera would: everything that stands where it looks, and is not held up."""

    needs_renderer = False

    def __init__(self, env: Any, seed: int) -> None:
        self.env = env

    def look(self) -> Observation:
        world = self.env.unwrapped
        (near, far), seen = world.camera.region(world.layout), []
        for index, (at, leaning) in enumerate(zip(positions(world), leaning_deg(world), strict=True)):
            body, waiting = world.bodies[index], bool(world.waiting()[0, index])
            in_sight = bool((at[:2] > near).all() and (at[:2] < far).all()) and not waiting
            if in_sight and -0.01 < at[2] < body.height_m / 2 + 0.01:
                half, tall, upright = body.half_width_m, body.height_m, bool(leaning < 10)
                seen.append(Detection((float(at[0]), float(at[1])), half, tall, 0.0, body.shape, upright, index == 0))
        return Observation(tuple(seen))


def loop_with(disturbance: Any, scene: Scene = SCENE, **changes: Any) -> ClosedLoop:
    reach = reach_of(compose("execute", []), "cpu", LAYOUT)
    planner = Exact(reach, max_nodes=10_000, max_seconds=20.0, max_memory_mb=256)
    plan = lambda scene: planner.plan(Batch.of(Problem(scene, reach)))[0]  # noqa: E731
    loop = ClosedLoop(Problem(scene, reach), "exact", plan, disturbance, LIMITS, TrueCamera)
    return replace(loop, **changes)


def carry_out(
    monkeypatch: pytest.MonkeyPatch, folder: Path, loop: ClosedLoop, each_step: Callable[[Any], None] | None = None
) -> ExecutionReport:
    """The report of a closed loop; `each_step` is called with the environment after every control step."""
    if each_step is not None:
        command = Operator._command

        def watched(self: Operator, joints: np.ndarray) -> None:
            command(self, joints)
            each_step(self._env)

        monkeypatch.setattr(Operator, "_command", watched)
    return execute(loop, SETUP, folder)


def kinds(report: ExecutionReport) -> list[str]:
    return [event["event"] for event in report.events]


def test_undisturbed_it_plans_once_and_claims_what_is_true(monkeypatch, tmp_path):
    report = carry_out(monkeypatch, tmp_path, loop_with(Nothing()))
    assert report.success
    assert report.claimed
    assert kinds(report).count("plan") == 1
    assert kinds(report)[-1] == "look"
    assert [move.outcome for move in report.moves] == [Outcome.DONE] * len(report.moves)
    assert report.conditions["success"]


@pytest.mark.parametrize(
    ("disturbance", "kind"),
    [
        (SlippingGrasp(at_grasp=1), "fault"),
        (SlippingGrasp(at_grasp=2), "fault"),
        (ObjectMoved(after_moves=1), "disturbance"),
        (ObjectMoved(after_moves=0), "disturbance"),
        (IntruderObject(after_moves=1), "disturbance"),
    ],
)
def test_what_goes_wrong_once_is_seen_and_recovered_from(monkeypatch, tmp_path, disturbance, kind):
    report = carry_out(monkeypatch, tmp_path, loop_with(disturbance))
    assert kind in kinds(report)
    assert report.success
    assert report.claimed
    assert report.conditions["success"]


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


def test_the_target_lost_at_the_very_end_is_never_claimed(monkeypatch, tmp_path):
    """Out of the hand after the last motion: the fingers sense it; if they are not asked, the ground truth says so."""

    class Late(TrueCamera):
        def look(self):
            seen, env = super().look(), self.env
            if not any(one.is_target for one in seen.objects):
                env.unwrapped.objects[0].set_pose(sapien.Pose(p=[1.5, 0.0, -1.0]))
                for _ in range(10):
                    env.step(torch.tensor([*env.unwrapped.agent.arm_joints()[0].tolist(), -1.0]))
            return seen

    report = carry_out(monkeypatch, tmp_path, loop_with(Nothing(), sensor=Late))
    assert report.outcome is Outcome.UNCONFIRMED
    assert "the hand: it holds nothing" in report.message
    assert not report.claimed
    with monkeypatch.context() as patch:
        patch.setattr(closed_loop.GripperSense, "holding", lambda self: True)
        report = carry_out(patch, tmp_path, loop_with(Nothing(), sensor=Late))
    assert report.claimed
    assert not report.success
    assert report.outcome is Outcome.INCOMPLETE


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
    full = Scene(LAYOUT, obstacles=tuple(cell for cell in range(18) if cell != 14), target=14)
    report = carry_out(monkeypatch, tmp_path, loop_with(Nothing(), full))
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


def test_the_same_seed_disturbs_the_same(monkeypatch, tmp_path):
    one, two = (carry_out(monkeypatch, tmp_path, loop_with(ObjectMoved(after_moves=0))) for _ in range(2))
    assert one.events == two.events


def test_without_a_camera_there_is_no_closed_loop(monkeypatch, tmp_path):
    monkeypatch.setattr(closed_loop, "render_backend", lambda: "none")
    with pytest.raises(InputError, match="closed needs a camera"):
        execute(loop_with(Nothing(), sensor=RgbdCamera), SETUP, tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_what_the_camera_cannot_see_is_bad_input_before_anything_is_made(tmp_path):
    low = replace(SETUP, camera=replace(SETUP.camera, position_m=(0.4, 0.0, 0.3)))
    with pytest.raises(InputError, match=r"camera\.position_m"):
        execute(loop_with(Nothing()), low, tmp_path / "none")
    full = Scene(LAYOUT, obstacles=tuple(cell for cell in range(18) if cell != 14), target=14)
    with pytest.raises(InputError, match="disturbance: puts in 1 more, and the scene has 0 cells left"):
        execute(loop_with(IntruderObject(1), full), SETUP, tmp_path / "none")
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize("disturbance", [Nothing(), SlippingGrasp(at_grasp=1)])
def test_the_arm_is_parked_before_each_look(monkeypatch, tmp_path, disturbance):
    """Where it hides nothing: at the middle of the staging line, but for the last look, when it holds the target."""
    at: list[list[float]] = []

    class Watched(TrueCamera):
        def look(self):
            at.append(self.env.unwrapped.agent.tcp_pos[0].tolist())
            return super().look()

    assert carry_out(monkeypatch, tmp_path, loop_with(disturbance, sensor=Watched)).success
    assert len(at) >= 3
    staging = [LAYOUT.front_m - SETUP.arm.staging_m, 0.0, SETUP.arm.grasp_height_m]
    assert np.allclose(at[:-1], staging, atol=0.01)
