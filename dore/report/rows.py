"""Rows as CSV: rows.csv of an evaluation, one row per instance and planner, and any other table."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from enum import StrEnum
from pathlib import Path
from typing import IO, Any

import pandas as pd

from dore.errors import InputError
from dore.files import atomic_write
from dore.world.plan import Status


class Timing(StrEnum):
    """What `planning_s` of a row means."""

    SINGLE = "single"
    """The instance was planned alone: a latency."""
    BATCHED = "batched"
    """A batch was planned together: the share that the planner attributes to the instance. Their mean is one over the
    throughput."""


@dataclass(frozen=True)
class Row:
    """How one planner did on one instance; the columns of rows.csv.

    instance: its number in the set, from 1. reason: why there is no solution, or empty.
    moves: rearrangements, as far as the plan goes. planning_s: wall seconds, see `timing`.
    layout: as messages name it. obstacles, target: cells from 1, with spaces between; empty in rows of version 0.1.
    """

    planner: str
    instance: int
    n_cells: int
    n_obstacles: int
    status: Status
    reason: str
    moves: int
    planning_s: float
    expansions: int
    timing: Timing
    layout: str = ""
    obstacles: str = ""
    target: str = ""


@dataclass(frozen=True, kw_only=True)
class BenchmarkRow(Row):
    """A row of the benchmark.

    reach: its name. density: obstacles, per cent of the cells. stratum: the class of its optimum. optimum: the proved
    fewest moves; empty where it is proved that there is no plan. cpu_s: CPU seconds of planning and of the check
    of the plan; of a batch, the mean.
    """

    reach: str
    density: int
    stratum: str
    optimum: int | None
    cpu_s: float


@dataclass(frozen=True, kw_only=True)
class ExecutedRow(Row):
    """A row of a plan that the simulated arm carried out; `planning_s`: of all the plans that the loop made.

    outcome: of `dore.sim.motion.outcome`. success: the ground truth. claimed: by what the loop itself knew, the target
    is out. refused: nothing was moved. moves_made: pick-and-places that were begun, the target's among them.
    faults: those that went wrong, as far as the loop saw. plans: how many it made. disturbance: what was done.
    toppled: an object does not stand. pushed: moves in which an object that should stand still moved by more than
    `pushed_m` of the arm. The worst of any move: placement_error_mm (none: nothing was put down), others_moved_mm,
    tilt_deg, grasp_margin_mm. wall_s, cpu_s: planning and rehearsal included.
    """

    outcome: str
    success: bool
    claimed: bool
    refused: bool
    moves_made: int
    faults: int
    plans: int
    disturbance: str
    toppled: bool
    pushed: int
    placement_error_mm: float | None
    others_moved_mm: float | None
    tilt_deg: float | None
    grasp_margin_mm: float | None
    simulated_s: float
    wall_s: float
    cpu_s: float
    message: str


MORE_TEXT = ("outcome", "disturbance", "message", "reach", "stratum")
"""Columns of text that some kinds of rows have."""
ROW_COLUMNS = tuple(field.name for field in fields(Row))
SCENE_COLUMNS = ("layout", "obstacles", "target")
TEXT_COLUMNS = ("planner", "status", "reason", "timing", *SCENE_COLUMNS)


def append_row(file: IO[str], row: Row) -> None:
    """Add a row to an open rows.csv, and flush it."""
    csv.writer(file, lineterminator="\n").writerow((asdict(row) | {"planning_s": f"{row.planning_s:.9f}"}).values())
    file.flush()


def write_rows(path: Path, rows: Iterable[Row], kind: type[Row] = Row) -> None:
    """Write rows.csv, whole or not at all. kind: of the rows."""
    with atomic_write(path) as file:
        file.write(",".join(field.name for field in fields(kind)) + "\n")
        for row in rows:
            append_row(file, row)


def read_rows(path: Path) -> pd.DataFrame:
    """The inverse of `write_rows`: a column for each field of `Row`, or of `ExecutedRow`.

    Raises:
        InputError: no such file, other columns, a value that is wrong, two rows of a planner on one instance, or
            planners with different instances or contradicting results; names the line where there is one.
    """
    rows = read_table(path, [name for name in ROW_COLUMNS if name not in SCENE_COLUMNS], TEXT_COLUMNS)
    for name, known in (("status", Status), ("timing", Timing)):
        wrong = ~rows[name].isin(list(known))
        if wrong.any():
            got = rows[name][wrong.idxmax()]
            raise InputError(f"{path}, line {wrong.idxmax() + 2}: {name} {got!r}, want one of {', '.join(known)}")
    for name in MORE_TEXT:
        if name in rows:
            rows[name] = rows[name].fillna("").astype(str)
    cut_off = (rows.target == "") & (rows.target != "").any()  # Version 0.1 has none in any row.
    if (lacking := rows[list(ROW_COLUMNS)].isna().any(axis=1) | cut_off).any():
        raise InputError(f"{path}, line {lacking.idxmax() + 2}: a value is missing")
    if (twice := rows.duplicated(["planner", "instance"])).any():
        one = rows[twice].iloc[0]
        raise InputError(f"{path}: {one.planner} has two rows of instance {one.instance}")
    check_proofs(rows, str(path))
    return rows


def check_proofs(rows: pd.DataFrame, where: str) -> None:
    """Refuse rows in which one planner solved what another one proved unsolvable.

    Raises:
        InputError: names the instance and both planners.
    """
    solved = rows[rows.status == Status.SOLVED].drop_duplicates("instance").set_index("instance").planner
    shut = rows[(rows.status == Status.UNSOLVABLE) & rows.instance.isin(solved.index)]
    if len(shut):
        one = shut.iloc[0]
        raise InputError(
            f"{where}: {solved[one.instance]} solved instance {one.instance}, and {one.planner} proved it unsolvable"
        )


def read_table(path: str | os.PathLike[str], columns: Sequence[str], text: Sequence[str] | None) -> pd.DataFrame:
    """A CSV file, its `text` columns as text; where `text` is None the columns are what their values look like.

    Raises:
        InputError: no such file, a missing column, or a value that is not a number.
    """
    kinds: dict[Any, Any] = dict.fromkeys(text or (), str)
    try:
        found = pd.read_csv(path, dtype=kinds, keep_default_na=False, na_values=[""])
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (ValueError, OSError) as error:
        raise InputError(f"{path}: cannot be read as CSV ({' '.join(str(error).split())})") from None
    if not isinstance(found.index, pd.RangeIndex):  # What pandas makes of lines that are longer than the first one.
        raise InputError(f"{path}: a line has more values than there are columns")
    if missing := sorted(set(columns) - set(found.columns)):
        raise InputError(f"{path}: no column {', '.join(missing)}")
    if text is None:
        return found
    for name in text:
        found[name] = found[name].fillna("") if name in found else ""
    for name in (one for one in columns if one not in text):
        wrong = pd.to_numeric(found[name], errors="coerce").isna() & found[name].notna()
        if wrong.any():
            got = found[name][wrong.idxmax()]
            raise InputError(f"{path}, line {wrong.idxmax() + 2}: {name} {got!r}, want a number")
    return found
