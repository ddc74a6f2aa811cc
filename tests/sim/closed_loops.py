"""Closed loops for tests: the simulator's state stands in for the camera, so that they run where nothing renders."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dore.planners.exact import Exact
from dore.sim.run.closed_loop import ClosedLoop, Limits
from dore.sim.run.execution import run_loop
from dore.sim.run.feedback import leaning_deg, positions
from dore.sim.run.operator import Operator
from dore.sim.run.report import ExecutionReport
from dore.sim.vision.scene_estimate import Detection, Observation
from dore.world.problem import Batch, Problem, Scene
from tests.setups import LAYOUT, setup

SCENE = Scene(LAYOUT, obstacles=(2, 8, 13), target=14)
FULL = Scene(LAYOUT, obstacles=tuple(cell for cell in range(18) if cell != 14), target=14)
LIMITS = Limits(max_moves=8, max_faults=2, max_looks=2)
SETUP = setup(seed=3)


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
    reach = SETUP.reach(LAYOUT)
    planner = Exact(reach, max_nodes=10_000, max_seconds=20.0, max_memory_mb=256)
    plan = lambda problem: planner.plan(Batch.of(problem))[0]  # noqa: E731
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
    return run_loop(loop, SETUP, folder)


def kinds(report: ExecutionReport) -> list[str]:
    return [event["event"] for event in report.events]
