"""Moves carried out while something interferes, and the feedback that notices it."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
import sapien

import dore.sim.scene.task  # noqa: F401  (registers the environment)
from dore.sim.motion.outcome import Outcome
from dore.sim.motion.rehearsal import Rehearsal, tasks_of
from dore.sim.run.feedback import PrivilegedState
from dore.sim.run.operator import Operator
from dore.sim.run.setup import CONTROL_S
from dore.world.plan import Move
from dore.world.problem import Scene
from tests.setups import ARM, LAYOUT, OBJECTS, plan_of, setup

pytestmark = pytest.mark.sim


@pytest.mark.parametrize(
    ("moved", "to", "after_steps", "outcome"),
    [
        (1, [0.56, 0.30, 0.076], 0, Outcome.WORLD_CHANGED),  # seen before the arm moves
        (1, [0.56, 0.30, 0.076], 30, Outcome.MISSED_GRASP),  # taken away as the hand comes
        (1, [0.56, 0.30, 0.076], 80, Outcome.DROPPED),  # taken out of the hand
        (0, [0.80, 0.33, 0.076], 30, Outcome.PUSHED),  # another object shifted within its cell
        (0, [0.895, 0.30, 0.03], 30, Outcome.TOPPLED),  # or laid down
        (1, None, 80, Outcome.SLIPPED),  # pulled down a little in the hand
    ],
)
def test_interference_is_noticed(moved, to, after_steps, outcome):
    scene = Scene(LAYOUT, obstacles=(2,), target=12)
    plan, bodies = plan_of(Move(2, 8, 0.0, 0.0), scene=scene), OBJECTS.draw(2, np.random.default_rng(0))
    env = gym.make(
        "DoreTabletop-v1", layout=LAYOUT, bodies=bodies, arm=ARM, obs_mode="none", reward_mode="none",
        control_mode="pd_joint_pos", sim_backend="physx_cpu", render_backend="none",
    )  # fmt: skip
    env.reset(seed=0, options={"cells": [12, 2]})
    steps = 0

    def disturb() -> None:
        nonlocal steps
        if steps == after_steps:
            here = env.unwrapped.objects[moved].pose
            pulled = sapien.Pose(p=here.p[0].numpy() - [0, 0, 0.009], q=here.q[0].numpy())
            lying = [0.5**0.5, 0.5**0.5, 0, 0] if to and to[2] < 0.05 else [1, 0, 0, 0]
            env.unwrapped.objects[moved].set_pose(sapien.Pose(p=to, q=lying) if to else pulled)
        steps += 1

    if after_steps == 0:
        disturb()
    rehearsal = Rehearsal(LAYOUT, setup().kinematics, bodies, CONTROL_S)
    operator = Operator(env, PrivilegedState(env.unwrapped), disturb)
    ended, _ = operator.run(rehearsal, rehearsal.start(scene), tasks_of(scene, plan.plan)[0])
    assert ended is outcome
    env.close()


def test_feedback_returns_what_it_sees_and_leaves_what_was_known():
    """An object off the middle of its cell and turned: in the state that is returned, and not in the one given."""
    scene, bodies = Scene(LAYOUT, obstacles=(2,), target=12), OBJECTS.draw(2, np.random.default_rng(0))
    rehearsal = Rehearsal(LAYOUT, setup().kinematics, bodies, CONTROL_S)
    known = rehearsal.start(scene)
    env = setup().environment(LAYOUT, bodies, "none")
    env.reset(options={"cells": [12, 2], "offsets_m": [[0.0, 0.0], [0.01, -0.02]], "yaws_rad": [0.4, 0.0]})
    outcome, seen = PrivilegedState(env.unwrapped).look(known)
    assert outcome is Outcome.DONE
    assert known.standing == rehearsal.start(scene).standing
    x, y = LAYOUT.cells[2]
    assert seen.standing[1].xy == pytest.approx((x + 0.01, y - 0.02), abs=1e-4)
    assert seen.standing[0].yaw_rad == pytest.approx(0.4, abs=1e-4)
    assert seen.cell_of == known.cell_of
    env.close()


def test_after_a_fault_in_the_grid_the_hand_leaves_the_way_it_came():
    """The object is taken out of the hand while it is put into its cell."""
    scene, bodies = Scene(LAYOUT, obstacles=(2,), target=12), OBJECTS.draw(2, np.random.default_rng(0))
    env = setup().environment(LAYOUT, bodies, "none")
    env.reset(options={"cells": [12, 2]})
    task, way = env.unwrapped, []

    def take() -> None:
        x = float(task.agent.tcp_pos[0, 0])
        carried = bool(task.positions()[0, 1, 2] > bodies[1].height_m / 2 + 0.02)
        if carried and x < LAYOUT.front_m and not way:
            way.append("before the grid")
        if carried and x > LAYOUT.front_m + 0.1 and way:
            way.append("in the grid")
            task.objects[1].set_pose(sapien.Pose(p=[0.56, 0.30, 0.076]))

    rehearsal = Rehearsal(LAYOUT, setup().kinematics, bodies, CONTROL_S)
    operator = Operator(env, PrivilegedState(task), take)
    move = tasks_of(scene, plan_of(Move(2, 8, 0.0, 0.0), scene=scene).plan)[0]
    outcome, _ = operator.run(rehearsal, rehearsal.start(scene), move)
    assert (outcome, way) == (Outcome.DROPPED, ["before the grid", "in the grid"])
    assert float(task.agent.tcp_pos[0, 0]) > LAYOUT.front_m + 0.1
    operator.recover()
    assert float(task.agent.tcp_pos[0, 0]) < LAYOUT.front_m
    assert float(task.agent.opening()[0]) > 0.95
    env.close()
