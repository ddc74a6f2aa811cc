"""Where the paper is silent: rearrangements of the optimum and of the baseline over reaches and corridors.

python -m scripts.reach_sensitivity --csv outputs/reach_sensitivity/rows.csv --report docs/results/reach_sensitivity
The CSV is written after every reach. Stopped, it goes on where it was; the page and the picture are made from the
CSV alone. Instances are of the validation split: the test split is kept for the tables.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import torch
from tqdm import tqdm

from dore.errors import InputError, number, seed_of, whole
from dore.planners.base import Planner
from dore.planners.exact import Exact
from dore.planners.straight_line import StraightLine
from dore.world.generator import Difficulty
from dore.world.instances import InstanceSet
from dore.world.layout import Layout
from dore.world.plan import Status
from dore.world.problem import Batch
from dore.world.reach import Reach
from scripts.paper_rows import OBSTACLES, REARRANGEMENTS
from scripts.reach_sensitivity_report import write_report
from scripts.reach_sensitivity_rows import (
    CHECK,
    GRID,
    Moves,
    Point,
    Row,
    distances,
    make_row,
    nearest,
    read_rows,
    sectors_of,
    write_rows,
)

LAYOUTS = {"3x6": (3, 6), "6x6": (6, 6)}
CELL_M = 0.12
"""The paper's cells (section 6.1)."""
COMMAND = "scripts/reach_sensitivity.sh"
MAX_MOVES = 30
"""Of the baseline, as in conf/planner/straight_line.yaml."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run what the CSV lacks, then write the report."""
    parser = _parser()
    chosen = parser.parse_args(arguments)
    torch.set_num_threads(1)
    try:
        run(chosen)
        write_report(chosen.csv, chosen.report, COMMAND)
    except InputError as error:
        parser.error(str(error))
    except KeyboardInterrupt:
        raise SystemExit("stopped; the same command goes on from here") from None
    print(f"{chosen.report}.md")


def run(chosen: argparse.Namespace) -> None:
    """The grid, then its nearest point once more on other instances; all that the CSV does not hold yet.

    Raises:
        InputError: an argument outside its domain, or a CSV of another study.
    """
    n, check_n = whole("--instances", chosen.instances, 1), whole("--check-instances", chosen.check_instances, 1)
    n_baseline = whole("--baseline-instances", chosen.baseline_instances, 1, at_most=n)
    seed = seed_of("--seed", chosen.seed)
    corridors = list(product(chosen.corridor, (False, True)))
    grid = [
        [Point(clearance, fan, *corridor) for corridor in corridors]
        for fan, clearance in product(chosen.fan, chosen.clearance)
    ]
    chosen.csv.parent.mkdir(parents=True, exist_ok=True)
    rows = read_rows(chosen.csv) if chosen.csv.exists() else []
    _continue(rows, chosen.csv, Stage(GRID, seed, n, n_baseline, chosen.obstacles), grid)
    best = nearest(distances(row for row in rows if row.stage == GRID))
    _continue(rows, chosen.csv, Stage(CHECK, seed + 1, check_n, check_n, chosen.obstacles), [[best]])


@dataclass(frozen=True)
class Stage:
    """On which instances points are looked at: `n` a column, the baseline on the first `n_baseline` of them."""

    name: str
    seed: int
    n: int
    n_baseline: int
    obstacles: Sequence[int]


def _continue(rows: list[Row], csv: Path, stage: Stage, grid: Sequence[Sequence[Point]]) -> None:
    """Add to `rows`, and to the file, what a stage lacks. A grid's inner lists share a reach."""
    mine = [row for row in rows if row.stage == stage.name]
    wanted = set(product((point for points in grid for point in points), REARRANGEMENTS, stage.obstacles))
    sizes = (stage.seed, stage.n, stage.n_baseline)
    if any(
        (row.point, row.board, row.obstacles) not in wanted or (row.seed, row.optimum_n, row.baseline_n) != sizes
        for row in mine
    ):
        raise InputError(f"{csv}: holds rows of other arguments, want another --csv or the file removed")
    done = {(row.point, row.board) for row in mine}
    with tqdm(total=len(grid) * len(REARRANGEMENTS), unit="reach", desc=stage.name) as bar:
        for points, board in product(grid, REARRANGEMENTS):
            if not done.issuperset((point, board) for point in points):
                rows += _study(stage, board, points)
                write_rows(csv, rows)
            bar.update()


def _study(stage: Stage, board: str, points: Sequence[Point]) -> list[Row]:
    """The rows of points that share a reach: the optimum is worked out once."""
    clearance, fan = points[0][:2]
    reach = Reach(Layout.grid(*LAYOUTS[board], CELL_M), clearance, fan, sectors_of(fan))
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


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="reach_sensitivity", description=__doc__)
    parser.add_argument("--csv", type=Path, required=True, help="the study's rows; gone on with where it exists")
    parser.add_argument("--report", type=Path, required=True, help="REPORT.md, REPORT.csv and REPORT.png are written")
    parser.add_argument("--instances", type=int, default=200, help="a column, for the optimum")
    parser.add_argument("--baseline-instances", type=int, default=50, help="the first of them, for the baseline")
    parser.add_argument("--check-instances", type=int, default=250, help="a column, for the nearest point once more")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--clearance", type=float, nargs="+", default=[0.106, 0.125, 0.142, 0.16, 0.175, 0.19, 0.205, 0.22]
    )
    parser.add_argument("--fan", type=float, nargs="+", default=[10.0, 15.0, 20.0, 25.0, 30.0], help="half, degrees")
    parser.add_argument(
        "--corridor",
        type=_corridor,
        nargs="+",
        default=[None, 0.06, 0.16, 0.22],
        help="the baseline's half widths, metres, or the word clearance",
    )
    parser.add_argument("--obstacles", type=int, nargs="+", choices=OBSTACLES, default=OBSTACLES, metavar="3..9")
    return parser


def _corridor(text: str) -> float | None:
    try:
        return None if text == "clearance" else number("--corridor", float(text), above=0.0)
    except ValueError:
        raise argparse.ArgumentTypeError(f"got {text!r}, want metres above 0, or the word clearance") from None


if __name__ == "__main__":
    main()
