"""Closed loops: the unexpected leads to looking and planning again, and what is claimed is true.

test_closed_loop_refusals.py has the loops that end in a refusal; test_camera.py tests the camera itself.
"""

from __future__ import annotations

import numpy as np
import pytest
import sapien
import torch

from dore.sim.motion.outcome import Outcome
from dore.sim.run import closed_loop
from dore.sim.run.disturbances import IntruderObject, Nothing, ObjectMoved, SlippingGrasp
from tests.setups import LAYOUT
from tests.sim.closed_loops import SETUP, TrueCamera, carry_out, kinds, loop_with

pytestmark = pytest.mark.sim


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
        patch.setattr(closed_loop.GripperFeedback, "holding", lambda self: True)
        report = carry_out(patch, tmp_path, loop_with(Nothing(), sensor=Late))
    assert report.claimed
    assert not report.success
    assert report.outcome is Outcome.INCOMPLETE


def test_the_same_seed_disturbs_the_same(monkeypatch, tmp_path):
    one, two = (carry_out(monkeypatch, tmp_path, loop_with(ObjectMoved(after_moves=0))) for _ in range(2))
    assert one.events == two.events


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
