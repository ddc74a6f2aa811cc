"""The execution report: what happened, move by move, as JSON with ids 1..G."""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from dore.files import write_record
from dore.sim.frames import turned
from dore.sim.motion.outcome import Outcome
from dore.sim.motion.rehearsal import MoveTask
from dore.sim.run.feedback import leaning_deg, positions, yaws
from dore.sim.scene.task import DoreTabletopEnv
from dore.world.problem import cell_id

REPORT_FORMAT = "dore-execution/1"
_PUT_DOWN = (Outcome.DONE, Outcome.MISPLACED, Outcome.PUSHED, Outcome.TOPPLED)


@dataclass(frozen=True)
class MoveReport:
    """One move. Ids count from 1; `place` is None for the target, which is held up at the end.

    placement_error_mm: distance of the object put down from its cell's centre; None if none was put down.
    others_moved_mm: the largest distance that an object has moved which should not.
    moved_mm: how far each of them has, by its index in `ExecutionReport.objects`.
    grasp_margin_mm: room between the open fingers and the object before they closed, on the tighter side.
    tilt_deg: how far the moved object leans.
    """

    name: str
    pick: int
    place: int | None
    outcome: Outcome
    placement_error_mm: float | None
    others_moved_mm: float
    moved_mm: dict[int, float]
    grasp_margin_mm: float
    tilt_deg: float
    simulated_s: float
    wall_s: float


@dataclass
class ExecutionReport:
    """A whole execution. `finished` is False in a file left by an interrupted one.

    message: one line for people. refused: nothing was moved, because the rehearsal found that the plan cannot be
    carried out. events: what a loop saw, planned and met, in order. claimed: by what the loop itself knew,
    the target is out. conditions: the ground truth of the task's own, all of which success needs. video: path beside
    the report.
    """

    outcome: Outcome
    message: str
    arm: str
    seed: int
    planner: str
    objects: list[dict[str, Any]]
    refused: bool = False
    finished: bool = False
    moves: list[MoveReport] = field(default_factory=list)
    conditions: dict[str, bool] = field(default_factory=dict)
    events: list[dict[str, Any]] = field(default_factory=list)
    claimed: bool = False
    simulated_s: float = 0.0
    rehearsal_s: float | None = None
    wall_s: float = 0.0
    video: str | None = None
    stills: list[str] = field(default_factory=list)
    pictures: str = ""

    @property
    def success(self) -> bool:
        """Every move done, and every condition met."""
        return self.finished and self.outcome is Outcome.DONE

    def write(self, path: Path) -> None:
        """Write the file whole or not at all.

        Raises:
            OSError: the disk is full or read-only.
        """
        write_record(path, {"format": REPORT_FORMAT, "success": self.success, **asdict(self)})


class MoveMeter:
    """Measures a move on the simulator's state, whatever the operator itself can know: made before it, read after it.

    Args:
        task: the environment.
        simulated_s: simulated seconds so far.
    """

    def __init__(self, task: DoreTabletopEnv, simulated_s: float) -> None:
        self._task, self._simulated_s = task, simulated_s
        self._wall, self._before = time.perf_counter(), positions(task)
        self._waiting = task.waiting()[0]
        self._yaw = yaws(task)

    def nearest(self, xy: tuple[float, float]) -> int:
        """The index of the object that stood nearest to a point, metres, when the meter was started."""
        return int(np.linalg.norm(self._before[:, :2] - xy, axis=1).argmin())

    def read(
        self, task: MoveTask, index: int, outcome: Outcome, simulated_s: float, aimed_xy: tuple[float, float] | None
    ) -> MoveReport:
        """The report of the move of the object `index`.

        aimed_xy: where the hand expected it, metres; None: where it was.
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
        body, yaw = self._task.bodies[index], self._yaw[index] - heading
        off = np.zeros(2) if aimed_xy is None else self._before[index, :2] - aimed_xy
        aside = abs(float(turned(off, -heading)[1]))
        half = body.half_width_m
        if body.shape == "cuboid":
            half *= abs(math.cos(yaw)) + abs(math.sin(yaw))
        return self._task.arm.model.half_opening_m - half - aside
