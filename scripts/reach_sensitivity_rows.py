"""The rows of the sensitivity study, and how far each point of its grid lies from the paper's Tables 2 and 3."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from statistics import fmean, stdev
from typing import NamedTuple

from dore.errors import InputError
from dore.files import atomic_write
from dore.report.estimates import mean as estimate
from scripts.paper_rows import REARRANGEMENTS

GRID, CHECK = "grid", "check"
"""Stages: every point of the grid; the nearest one again, on more instances of another seed."""

PRINTED = 0.05
"""The paper prints one decimal: nearer than this is as near as it gets."""


class Point(NamedTuple):
    """What the paper does not say.

    corridor_m: half width of the baseline's corridor, metres; None: the reach's clearance.
    """

    clearance_m: float
    half_fan_deg: float
    corridor_m: float | None
    avoid_corridors: bool


@dataclass(frozen=True)
class Row:
    """A board, a point and a column; the columns of the CSV. Means, sds and 95 % intervals are of rearrangements.

    optimum: over the instances that can be solved, the first `optimum_n` of the set.
    both, baseline: the optimum's mean, and the baseline, over those of the first `baseline_n` that both solve.
    *_solved: shares. paper_*: Table 2 or 3.
    """

    stage: str
    seed: int
    board: str
    clearance_m: float
    half_fan_deg: float
    n_sectors: int
    corridor_m: float | None
    avoid_corridors: bool
    obstacles: int
    optimum_n: int
    optimum_solved: float
    optimum_mean: float
    optimum_sd: float
    optimum_low: float
    optimum_high: float
    baseline_n: int
    baseline_solved: float
    baseline_mean: float
    baseline_sd: float
    baseline_low: float
    baseline_high: float
    both_optimum_mean: float
    paper_dqn_mean: float
    paper_dqn_sd: float
    paper_baseline_mean: float
    paper_baseline_sd: float

    @property
    def point(self) -> Point:
        """Where on the grid the row lies."""
        return Point(self.clearance_m, self.half_fan_deg, self.corridor_m, self.avoid_corridors)


class Distance(NamedTuple):
    """How far one point is from the paper on one board: root mean squares over the columns, in rearrangements.

    dqn: the optimum, over all that can be solved, against the DQN's row. baseline: the baselines, over what both
    planners solve. dqn_both: as dqn, but over what both solve.
    above: in so many columns the optimum is above the DQN's mean by more than the 95 % interval of the difference,
    which no planner of the same problem could be.
    """

    dqn: float
    baseline: float
    dqn_both: float
    above: int


class Fit(NamedTuple):
    """How far a point is from the paper over its boards together.

    dqn, baseline: root mean squares over both boards' columns, in rearrangements.
    joint: root mean square of the two, each in units of the least that any point of the grid reaches, so that the
    row that no point comes near does not decide alone. plain: of the two as they are.
    """

    dqn: float
    baseline: float
    joint: float
    plain: float


def make_row(stage: str, seed: int, board: str, point: Point, obstacles: int, moves: Sequence[Moves]) -> Row:
    """The row of one column: `moves` holds each instance's rearrangements, the baseline's for the first of them."""
    optimum = [one.optimum for one in moves if one.optimum is not None]
    tried = [one for one in moves if one.tried]
    both = [(a, b) for a, b, _ in tried if a is not None and b is not None]
    baseline = [b for _, b in both]
    ours, theirs = estimate(optimum), estimate(baseline)
    paper = REARRANGEMENTS[board]
    dqn, base = paper["dqn"][obstacles], paper["baseline"][obstacles]
    return Row(
        stage, seed, board, point.clearance_m, point.half_fan_deg, sectors_of(point.half_fan_deg), point.corridor_m,
        point.avoid_corridors, obstacles,
        len(moves), len(optimum) / len(moves), ours.mean, _sd(optimum), ours.low, ours.high,
        len(tried), len(both) / len(tried), theirs.mean, _sd(baseline), theirs.low, theirs.high,
        fmean([a for a, _ in both]) if both else math.nan,
        dqn.mean, dqn.sd, base.mean, base.sd,
    )  # fmt: skip


class Moves(NamedTuple):
    """One instance's rearrangements; None where a planner has no plan. tried: whether the baseline was asked."""

    optimum: int | None
    baseline: int | None
    tried: bool


def sectors_of(half_fan_deg: float) -> int:
    """About one sector a degree, as in the published constants."""
    return round(2 * half_fan_deg)


def distances(rows: Iterable[Row]) -> dict[Point, dict[str, Distance]]:
    """Each point's distance on each board, in the order of the rows."""
    groups: dict[Point, dict[str, list[Row]]] = {}
    for row in rows:
        groups.setdefault(row.point, {}).setdefault(row.board, []).append(row)
    return {point: {board: distance(columns) for board, columns in boards.items()} for point, boards in groups.items()}


def distance(columns: Sequence[Row]) -> Distance:
    """One point's distance on one board; nan where a column has no instance to compare on."""
    return Distance(
        _rms([row.optimum_mean - row.paper_dqn_mean for row in columns]),
        _rms([row.baseline_mean - row.paper_baseline_mean for row in columns]),
        _rms([row.both_optimum_mean - row.paper_dqn_mean for row in columns]),
        sum(_is_above(row) for row in columns),
    )


def fits(found: dict[Point, dict[str, Distance]]) -> dict[Point, Fit]:
    """Each point's fit over its boards together; points that lack a distance are left out.

    Raises:
        InputError: no point has all its distances.
    """
    pooled = {
        point: (_rms([one.dqn for one in boards.values()]), _rms([one.baseline for one in boards.values()]))
        for point, boards in found.items()
    }
    pooled = {point: both for point, both in pooled.items() if not math.isnan(sum(both))}
    if not pooled:
        raise InputError("rows: no point has instances that both planners solve in every column, want more instances")
    least = [max(PRINTED, min(column)) for column in zip(*pooled.values(), strict=True)]
    return {
        point: Fit(*both, _rms([far / near for far, near in zip(both, least, strict=True)]), _rms(both))
        for point, both in pooled.items()
    }


def nearest(found: dict[Point, dict[str, Distance]]) -> Point:
    """The point of the least joint distance, of two as near the first; raises what `fits` raises."""
    known = fits(found)
    return min(known, key=lambda point: known[point].joint)


def _is_above(row: Row) -> bool:
    paper = REARRANGEMENTS[row.board]["dqn"][row.obstacles]
    return row.optimum_mean - paper.mean > math.hypot(row.optimum_high - row.optimum_mean, paper.half95)


def _rms(values: Sequence[float]) -> float:
    return math.sqrt(fmean([value**2 for value in values]))


def _sd(values: Sequence[int]) -> float:
    return stdev(values) if len(values) > 1 else math.nan


COLUMNS = tuple(field.name for field in fields(Row))
TEXT, WHOLE = {"stage", "board"}, {"seed", "n_sectors", "obstacles", "optimum_n", "baseline_n"}


def write_rows(path: str | os.PathLike[str], rows: Sequence[Row]) -> None:
    """Write the CSV by stage and point, whole or not at all; to 4 decimals, an empty corridor means None."""
    with atomic_write(path) as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        for row in sorted(rows, key=_place):
            record = asdict(row)
            writer.writerow({k: round(v, 4) if isinstance(v, float) else v for k, v in record.items()})


def _place(row: Row) -> tuple[object, ...]:
    corridor = row.corridor_m or 0.0
    return row.stage != GRID, row.half_fan_deg, row.clearance_m, row.board, corridor, row.avoid_corridors, row.obstacles


def read_rows(path: str | os.PathLike[str]) -> list[Row]:
    """The inverse of `write_rows`.

    Raises:
        InputError: no such file, other columns, or a value that is wrong; names the line.
    """
    try:
        with Path(path).open(encoding="utf-8", newline="") as file:
            reader = csv.DictReader(file)
            if tuple(reader.fieldnames or ()) != COLUMNS:
                raise InputError(f"{path}: columns {reader.fieldnames}, want {', '.join(COLUMNS)}")
            return [_parse(f"{path}, line {reader.line_num}", record) for record in reader]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read as CSV ({error})") from None


def _parse(where: str, record: dict[str, str]) -> Row:
    try:
        values = {name: _value(name, text) for name, text in record.items()}
    except (TypeError, ValueError, KeyError) as error:
        raise InputError(f"{where}: {error}") from None
    return Row(**values)  # type: ignore[arg-type]


def _value(name: str, text: str) -> str | int | float | bool | None:
    if name in TEXT:
        return text
    if name in WHOLE:
        return int(text)
    if name == "avoid_corridors":
        return {"True": True, "False": False}[text]
    return None if name == "corridor_m" and not text else float(text)
