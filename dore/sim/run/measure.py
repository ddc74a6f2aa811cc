"""What a move did, measured on the simulator's own state, whatever the operator itself could know."""

from __future__ import annotations

import math
import time

import numpy as np

from dore.sim.motion.frames import Array
from dore.sim.motion.outcome import Outcome
from dore.sim.motion.rehearsal import MoveTask
from dore.sim.run.feedback import leaning_deg, positions
from dore.sim.run.report import MoveReport
from dore.sim.scene.task import DoreTabletopEnv
from dore.world.plan import cell_id

_PUT_DOWN = (Outcome.DONE, Outcome.MISPLACED, Outcome.PUSHED, Outcome.TOPPLED)


class MoveMeter:
    """Started before a move, read after it.

    Args:
        task: the environment.
        simulated_s: simulated seconds so far.
    """

    def __init__(self, task: DoreTabletopEnv, simulated_s: float) -> None:
        self._task, self._simulated_s = task, simulated_s
        self._wall, self._before = time.perf_counter(), positions(task)
        self._waiting = task.waiting()[0]
        self._yaw = [_yaw(actor.pose.to_transformation_matrix()[0]) for actor in task.objects]

    def nearest(self, xy: tuple[float, float]) -> int:
        """The index of the object that stood nearest to a point, metres, when the meter was started."""
        return int(np.linalg.norm(self._before[:, :2] - xy, axis=1).argmin())

    def read(
        self, task: MoveTask, index: int, outcome: Outcome, simulated_s: float, aimed_xy: tuple[float, float] | None
    ) -> MoveReport:
        """What became of the move of the object `index`.

        aimed_xy: where the hand took it to be, metres; None: where it was.
        """
        after, layout = positions(self._task), self._task.layout
        moved = 1e3 * np.linalg.norm(after - self._before, axis=1)
        beside = (self._waiting | self._task.waiting()[0]).tolist()
        others = {i: round(float(moved[i]), 2) for i in range(len(moved)) if i != index and not beside[i]}
        error = None
        if task.place_cell is not None and outcome in _PUT_DOWN:
            error = round(1e3 * float(np.linalg.norm(after[index, :2] - layout.cells[task.place_cell])), 2)
        return MoveReport(
            name=task.name,
            pick=cell_id(task.pick_cell),
            place=None if task.place_cell is None else cell_id(task.place_cell),
            outcome=outcome,
            placement_error_mm=error,
            others_moved_mm=max(others.values(), default=0.0),
            moved_mm=others,
            grasp_margin_mm=round(1e3 * self._grasp_margin_m(task, index, aimed_xy), 2),
            tilt_deg=round(float(leaning_deg(self._task)[index]), 2),
            simulated_s=round(simulated_s - self._simulated_s, 3),
            wall_s=round(time.perf_counter() - self._wall, 3),
        )

    def _grasp_margin_m(self, task: MoveTask, index: int, aimed_xy: tuple[float, float] | None) -> float:
        """Room between the open fingers and the object before they close, on the tighter side."""
        x, y = self._task.layout.cells[task.pick_cell]
        heading = math.atan2(y, x) + math.radians(task.pick_direction_deg)
        body, turned = self._task.bodies[index], self._yaw[index] - heading
        off = np.zeros(2) if aimed_xy is None else self._before[index, :2] - aimed_xy
        aside = abs(float(off[1]) * math.cos(heading) - float(off[0]) * math.sin(heading))
        half = body.half_width_m
        if body.shape == "cuboid":
            half *= abs(math.cos(turned)) + abs(math.sin(turned))
        return self._task.arm.model.half_opening_m - half - aside


def _yaw(pose: Array) -> float:
    return math.atan2(float(pose[1, 0]), float(pose[0, 0]))
