"""The dry run: what cannot be carried out is refused by name, and nothing is remembered between calls."""

from __future__ import annotations

import numpy as np
import pytest

from dore.sim.motion.outcome import Outcome, Refused
from dore.sim.motion.rehearsal import Rehearsal, tasks_of
from dore.sim.run.open_loop import OpenLoop
from dore.sim.run.setup import CONTROL_S
from dore.world.layout import Layout
from dore.world.plan import Move
from dore.world.problem import Scene
from tests.setups import LAYOUT, OBJECTS, plan_of, setup

pytestmark = pytest.mark.sim


def test_a_carried_object_that_would_touch_another_is_refused():
    scene = Scene(LAYOUT, obstacles=(2, 9), target=17)
    plan = plan_of(Move(2, 14, 0.0, 24.0), scene=scene)
    with pytest.raises(
        Refused, match=r"move 1 \(3 to 15\): insert: the .* would touch the object on cell 10"
    ) as caught:
        OpenLoop(plan).begin(setup(), OBJECTS.draw(3, np.random.default_rng(0)))
    assert caught.value.outcome is Outcome.BLOCKED


def test_what_the_arm_cannot_reach_is_refused():
    bodies, kinematics = OBJECTS.draw(1, np.random.default_rng(0)), setup().kinematics
    for layout, cell, direction, says in (
        (Layout.grid(3, 6, 0.12, 0.90), 14, 0.0, r"target \(15\): approach: no joint angles"),
        (LAYOUT, 0, 55.0, r"target \(1\): its corridor heads 8"),
        (LAYOUT, 17, 40.0, r"its corridor begins at y = -0\.4\d+ m, want within \+-0\.42"),
    ):
        scene, rehearsal = Scene(layout, (), cell), Rehearsal(layout, kinematics, bodies, CONTROL_S)
        with pytest.raises(Refused, match=says) as caught:
            rehearsal.play(rehearsal.start(scene), tasks_of(scene, plan_of(target_direction_deg=direction).plan))
        assert caught.value.outcome is Outcome.OUT_OF_REACH


def test_a_rehearsal_depends_on_state_and_task_alone():
    """The same question in between others gets the same answer, and no state is changed by one."""
    scene = Scene(LAYOUT, obstacles=(2, 9), target=12)
    first, second, _ = tasks_of(scene, plan_of(Move(2, 8, 0.0, 0.0), Move(9, 10, 0.0, 0.0), scene=scene).plan)
    rehearsal = Rehearsal(LAYOUT, setup().kinematics, OBJECTS.draw(3, np.random.default_rng(0)), CONTROL_S)
    start = rehearsal.start(scene)
    motions, lifted = rehearsal.pick_up(start, first)
    x, y, _ = lifted.arm.xyz.tolist()
    down, after = rehearsal.put_down(lifted, first, held_xy=(x + 0.005, y))
    rehearsal.play(after, [second])
    assert start.standing == rehearsal.start(scene).standing
    assert set(lifted.standing) == {0, 2}
    assert after.cell_of == {0: 12, 1: 8, 2: 9}
    repeated = rehearsal.pick_up(start, first)[0], rehearsal.put_down(lifted, first, held_xy=(x + 0.005, y))[0]
    for given, again in zip((motions, down), repeated, strict=True):
        assert list(given) == list(again)
        assert all(np.array_equal(given[name], again[name]) for name in given)
