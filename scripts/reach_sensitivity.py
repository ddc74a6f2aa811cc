"""Rearrangements of the proved optimum and of the straight-line baseline over reaches and corridors, as a CSV.

The paper gives neither. `dore-report study=reach_sensitivity run=true` runs this twice: over the whole grid, and on
other instances for the point that came nearest. The CSV is written after every reach; started again, it goes on from
there. Instances are of the validation split: the test split is kept for the tables.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from statistics import fmean, stdev
from typing import Any, NamedTuple

import pandas as pd
import torch
from tqdm import tqdm

from dore.errors import InputError, number, seed_of, whole
from dore.files import ABOUT_FILE, atomic_write, commit
from dore.planners.base import Planner
from dore.planners.exact import Exact
from dore.planners.straight_line import StraightLine
from dore.report import estimates
from dore.report.rows import read_table
from dore.report.sources import paper_table
from dore.world.generator import Difficulty
from dore.world.instances import InstanceSet
from dore.world.layout import Layout
from dore.world.plan import Status
from dore.world.problem import Batch
from dore.world.reach import Reach

LAYOUTS = {"3x6": (3, 6), "6x6": (6, 6)}
CELL_M = 0.12
"""The paper's cells (section 6.1)."""
OBSTACLES = (3, 4, 5, 6, 7, 8, 9)
"""The columns of the paper's Tables 2 and 3."""
GRID, CHECK = "grid", "check"
MAX_MOVES = 30
"""Of the baseline, as in conf/planner/straight_line.yaml."""
TEXT = ("stage", "board", "avoid_corridors")
COLUMNS = (
    "stage", "seed", "board", "clearance_m", "half_fan_deg", "n_sectors", "corridor_m", "avoid_corridors", "obstacles",
    *(f"optimum_{what}" for what in ("n", "solved", "mean", "sd", "low", "high")),
    *(f"baseline_{what}" for what in ("n", "solved", "mean", "sd", "low", "high")),
    "both_optimum_mean", "paper_dqn_mean", "paper_dqn_sd", "paper_baseline_mean", "paper_baseline_sd",
)  # fmt: skip
"""Means, sds and 95 % intervals are of rearrangements.

optimum: over the instances that can be solved, the first `optimum_n` of the set. both, baseline: the optimum's mean,
and the baseline, over those of the first `baseline_n` that both solve. *_solved: shares. paper_*: Table 2 or 3.
"""
Row = dict[str, Any]


class Point(NamedTuple):
    """What the paper does not say.

    corridor_m: half width of the baseline's corridor, metres; None: the reach's clearance.
    """

    clearance_m: float
    half_fan_deg: float
    corridor_m: float | None
    avoid_corridors: bool

    @property
    def n_sectors(self) -> int:
        """About one sector a degree, as in the published constants."""
        return round(2 * self.half_fan_deg)


class Moves(NamedTuple):
    """One instance's rearrangements; None where a planner has no plan. tried: whether the baseline was asked."""

    optimum: int | None
    baseline: int | None
    tried: bool


@dataclass(frozen=True)
class Stage:
    """On which instances points are measured: `n` a column, the baseline on the first `n_baseline` of them."""

    name: str
    seed: int
    n: int
    n_baseline: int
    obstacles: Sequence[int]


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure what the CSV lacks of a stage."""
    parser = _parser()
    chosen = parser.parse_args(arguments)
    torch.set_num_threads(1)
    try:
        n = whole("--instances", chosen.instances, 1)
        n_baseline = whole("--baseline-instances", chosen.baseline_instances, 1, at_most=n)
        stage = Stage(chosen.stage, seed_of("--seed", chosen.seed), n, n_baseline, chosen.obstacles)
        corridors = list(product(chosen.corridor, [word == "yes" for word in chosen.avoid]))
        reaches = product(chosen.fan, chosen.clearance)
        measure(chosen.csv, stage, [[Point(r, fan, *corridor) for corridor in corridors] for fan, r in reaches])
    except InputError as error:
        parser.error(str(error))
    except KeyboardInterrupt:
        raise SystemExit("stopped; the same command goes on from here") from None


def measure(csv: Path, stage: Stage, grid: Sequence[Sequence[Point]]) -> None:
    """Add to a CSV what it lacks of a stage. A grid's inner lists share a reach.

    Raises:
        InputError: a CSV that cannot be read, or that holds rows of other arguments.
    """
    rows = read_rows(csv) if csv.exists() else []
    mine = [row for row in rows if row["stage"] == stage.name]
    wanted = set(product((point for points in grid for point in points), LAYOUTS, stage.obstacles))
    sizes = (stage.seed, stage.n, stage.n_baseline)
    if any(
        (_point(row), row["board"], row["obstacles"]) not in wanted
        or (row["seed"], row["optimum_n"], row["baseline_n"]) != sizes
        for row in mine
    ):
        raise InputError(f"{csv}: holds rows of other arguments, want another CSV or the file removed")
    done = {(_point(row), row["board"]) for row in mine}
    csv.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(csv.with_name(ABOUT_FILE)) as file:
        json.dump({"commit": commit()}, file)
    with tqdm(total=len(grid) * len(LAYOUTS), unit="reach", desc=stage.name) as bar:
        for points, board in product(grid, LAYOUTS):
            if not done.issuperset((point, board) for point in points):
                rows += _study(stage, board, points)
                write_rows(csv, rows)
            bar.update()


def _study(stage: Stage, board: str, points: Sequence[Point]) -> list[Row]:
    """The rows of points that share a reach: the optimum is worked out once."""
    clearance, fan = points[0][:2]
    reach = Reach(Layout.grid(*LAYOUTS[board], CELL_M), clearance, fan, points[0].n_sectors)
    exact = Exact(reach, max_nodes=10_000_000, max_seconds=60.0, max_memory_mb=2048)
    baselines = [StraightLine(reach, 0.0, 0.0, *point[2:], MAX_MOVES) for point in points]
    rows = []
    for z in stage.obstacles:
        instances = InstanceSet.generate(reach, stage.n, Difficulty(z, z), "validation", stage.seed)
        optimum = _moves(exact, instances.batch())
        tried, untried = optimum[: stage.n_baseline], optimum[stage.n_baseline :]
        for point, baseline in zip(points, baselines, strict=True):
            theirs = _moves(baseline, instances.batch(slice(stage.n_baseline)))
            moves = [Moves(a, b, True) for a, b in zip(tried, theirs, strict=True)]
            moves += [Moves(a, None, False) for a in untried]
            rows.append(make_row(stage.name, stage.seed, board, point, z, moves))
    return rows


def _moves(planner: Planner, batch: Batch) -> list[int | None]:
    """Each instance's rearrangements, where the planner solves it."""
    return [len(plan.moves) if plan.status is Status.SOLVED else None for plan in planner.plan(batch)]


def make_row(stage: str, seed: int, board: str, point: Point, obstacles: int, moves: Sequence[Moves]) -> Row:
    """The row of one column: `moves` holds each instance's rearrangements, the baseline's for the first of them."""
    optimum = [one.optimum for one in moves if one.optimum is not None]
    tried = [one for one in moves if one.tried]
    both = [(a, b) for a, b, _ in tried if a is not None and b is not None]
    baseline = [b for _, b in both]
    values = (
        *(stage, seed, board, point.clearance_m, point.half_fan_deg, point.n_sectors, *point[2:], obstacles),
        *(len(moves), len(optimum) / len(moves), *_spread(optimum)),
        *(len(tried), len(both) / len(tried), *_spread(baseline)),
        fmean([a for a, _ in both]) if both else math.nan,
        *_paper(board, "dqn", obstacles),
        *_paper(board, "baseline", obstacles),
    )
    return dict(zip(COLUMNS, values, strict=True))


def _spread(values: Sequence[int]) -> tuple[float, ...]:
    """Mean, standard deviation, and the ends of the mean's interval."""
    found = estimates.sample_mean(values)
    return found.mean, stdev(values) if len(values) > 1 else math.nan, found.low, found.high


def _paper(board: str, method: str, obstacles: int) -> tuple[float, float]:
    table = paper_table(f"rearrangements_{board}")
    one = table[(table.method == method) & (table.column == str(obstacles))].iloc[0]
    return float(one["mean"]), float(one["sd"])


def write_rows(path: Path, rows: Sequence[Row]) -> None:
    """Write the CSV by stage and point, whole or not at all; to 4 decimals, an empty corridor means None."""
    table = pd.DataFrame(sorted(rows, key=_place), columns=list(COLUMNS)).round(4)
    with atomic_write(path) as file:
        table.to_csv(file, index=False, lineterminator="\n")


def _place(row: Row) -> tuple[object, ...]:
    point = _point(row)
    corridor = (point.corridor_m or 0.0, point.avoid_corridors)
    return row["stage"] != GRID, point.half_fan_deg, point.clearance_m, row["board"], *corridor, row["obstacles"]


def _point(row: Row) -> Point:
    return Point(*(row[name] for name in Point._fields))


def read_rows(path: Path) -> list[Row]:
    """The inverse of `write_rows`.

    Raises:
        InputError: a missing column, or a value that is not a number; names the line.
    """
    table = read_table(path, COLUMNS, TEXT)
    table["avoid_corridors"] = table.avoid_corridors == "True"
    rows: list[Row] = table.astype(object).where(table.notna(), None).to_dict("records")
    return rows


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="reach_sensitivity", description=__doc__)
    parser.add_argument("csv", type=Path, help="the rows; what it holds already is not measured again")
    parser.add_argument("--stage", choices=(GRID, CHECK), default=GRID)
    parser.add_argument("--instances", type=int, default=200, help="a column, for the optimum")
    parser.add_argument("--baseline-instances", type=int, default=50, help="the first of them, for the baseline")
    parser.add_argument("--seed", type=int, default=0)
    clearances = [0.106, 0.125, 0.142, 0.16, 0.175, 0.19, 0.205, 0.22]
    parser.add_argument("--clearance", type=float, nargs="+", default=clearances, help="metres")
    parser.add_argument("--fan", type=float, nargs="+", default=[10.0, 15.0, 20.0, 25.0, 30.0], help="half, degrees")
    corridor = "the baseline's half widths, metres, or the word clearance"
    parser.add_argument("--corridor", type=_corridor, nargs="+", default=[None, 0.06, 0.16, 0.22], help=corridor)
    avoid = "whether the baseline puts nothing into corridors"
    parser.add_argument("--avoid", nargs="+", choices=("no", "yes"), default=("no", "yes"), help=avoid)
    parser.add_argument("--obstacles", type=int, nargs="+", choices=OBSTACLES, default=OBSTACLES, metavar="3..9")
    return parser


def _corridor(text: str) -> float | None:
    try:
        return None if text == "clearance" else number("--corridor", float(text), above=0.0)
    except ValueError:
        raise argparse.ArgumentTypeError(f"got {text!r}, want metres above 0, or the word clearance") from None


if __name__ == "__main__":
    main()
