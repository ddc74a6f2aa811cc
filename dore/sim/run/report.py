"""The execution report: what happened, move by move, as JSON with ids 1..G."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from dore.files import atomic_write
from dore.sim.motion.outcome import Outcome

REPORT_FORMAT = "dore-execution/1"


@dataclass(frozen=True)
class MoveReport:
    """One move. Ids as in the paper, 1..G; `place` is None for the target, which is held up at the end.

    placement_error_mm: how far the object put down stands from its cell's centre; None where none was put down.
    others_moved_mm: how far the object that moved most, of those that should not, has moved.
    moved_mm: how far each of them has, by its place in `ExecutionReport.objects`, from 0.
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

    message: one line for people. refused: True if nothing was moved, because the rehearsal found that the plan
    cannot be carried out. events: what a closed loop saw, planned and met, in order. claimed: by what it saw and felt,
    a closed loop holds the target. conditions: the task's own, all of which success needs. video: path beside the
    report.
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
        """Write it whole or not at all.

        Raises:
            OSError: the disk is full or read-only.
        """
        with atomic_write(path) as file:
            fields = {"format": REPORT_FORMAT, "success": self.success, **asdict(self)}
            json.dump(fields, file, indent=2)
            file.write("\n")
