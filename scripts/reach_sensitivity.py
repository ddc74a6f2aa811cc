"""Rearrangements of the proved optimum and of the straight-line baseline over reaches and corridors.

python -m scripts.reach_sensitivity out=FOLDER [clearance=[0.19]] [fan=[20]] [corridor=[null,0.16]] [avoid=[false]] ...
FOLDER/rows.csv has a row a reach, corridor, board and number of obstacles. The paper gives neither reach nor corridor.
`dore-report study=reach_sensitivity run=true` runs this for every clearance of a grid, and on other instances for the
point that came nearest. Instances are of the validation split: the test split is kept for the tables.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

from tqdm import tqdm

from dore.errors import whole
from dore.planners.base import Planner
from dore.planners.exact import Exact
from dore.planners.straight_line import StraightLine
from dore.report import estimates
from dore.report.measurements import write_measurements
from dore.report.sources import paper_table
from dore.world.generator import Difficulty
from dore.world.instances import InstanceSet
from dore.world.layout import Layout
from dore.world.plan import Status
from dore.world.problem import Batch
from dore.world.reach import Reach
from scripts.program import run

LAYOUTS = {"3x6": (3, 6), "6x6": (6, 6)}
CELL_M = 0.12
"""The paper's cells (section 6.1)."""
MAX_MOVES = 30
"""Of the baseline, as in conf/planner/straight_line.yaml."""
Row = dict[str, Any]


@dataclass(frozen=True)
class Options:
    """What is measured: every combination of clearance, fan, corridor and avoid.

    out: the folder of the rows. clearance: metres. fan: half, degrees. corridor: the baseline's half widths, metres;
    None: the clearance. avoid: whether the baseline puts nothing into corridors. instances: a column, for the optimum;
    baseline_instances: the first of them, for the baseline. obstacles: the columns of the paper's Tables 2 and 3.
    """

    out: Path
    clearance: list[float] = field(default_factory=lambda: [0.19])
    fan: list[float] = field(default_factory=lambda: [10.0, 15.0, 20.0, 25.0, 30.0])
    corridor: list[float | None] = field(default_factory=lambda: [None, 0.06, 0.16, 0.22])
    avoid: list[bool] = field(default_factory=lambda: [False, True])
    instances: int = 200
    baseline_instances: int = 50
    seed: int = 0
    obstacles: list[int] = field(default_factory=lambda: [3, 4, 5, 6, 7, 8, 9])

    def __post_init__(self) -> None:
        whole("instances", self.instances, 1)
        whole("baseline_instances", self.baseline_instances, 1, at_most=self.instances)
        for obstacles in self.obstacles:
            whole("obstacles", obstacles, 3, at_most=9)


def main(options: Options) -> None:
    """Measure and write the rows."""
    corridors = list(product(options.corridor, options.avoid))
    studies = []
    for fan, clearance, board in product(options.fan, options.clearance, LAYOUTS):
        # About one sector a degree, as in the published constants.
        reach = Reach(Layout.grid(*LAYOUTS[board], CELL_M), clearance, fan, round(2 * fan))
        studies.append((board, [StraightLine(reach, 0.0, 0.0, *one, MAX_MOVES) for one in corridors]))
    rows = [row for board, baselines in tqdm(studies, unit="reach") for row in study(options, board, baselines)]
    write_measurements(options.out, rows)


def study(options: Options, board: str, baselines: Sequence[StraightLine]) -> list[Row]:
    """The rows of baselines that share a reach: the optimum is worked out once for all."""
    reach = baselines[0].reach
    exact = Exact(reach, max_nodes=10_000_000, max_seconds=60.0, max_memory_mb=2048)
    sets = [
        InstanceSet.generate(reach, options.instances, Difficulty(z, z), "validation", options.seed)
        for z in options.obstacles
    ]
    optima = [moves_of(exact, instances.batch()) for instances in sets]
    rows = []
    for (width, avoids), baseline in zip(product(options.corridor, options.avoid), baselines, strict=True):
        point = {"board": board, "clearance_m": reach.clearance_m, "half_fan_deg": reach.half_fan_deg}
        point |= {"n_sectors": reach.n_sectors, "corridor_m": width, "avoid_corridors": avoids}
        for z, instances, optimum in zip(options.obstacles, sets, optima, strict=True):
            theirs = moves_of(baseline, instances.batch(slice(options.baseline_instances)))
            found = measures(optimum, theirs)
            rows.append({"seed": options.seed, **point, "obstacles": z, **found, **paper(board, z)})
    return rows


def moves_of(planner: Planner, batch: Batch) -> list[int | None]:
    """Each instance's rearrangements, where the planner solves it."""
    return [len(plan.moves) if plan.status is Status.SOLVED else None for plan in planner.plan(batch)]


def measures(optima: Sequence[int | None], baseline: Sequence[int | None]) -> Row:
    """Means, sds and 95 % intervals of rearrangements, to 4 decimals; None: no plan.

    optimum: over the instances that can be solved, the first `optimum_n` of the set. baseline, both_optimum: the
    baseline's, and the optimum's mean, over those of the first `baseline_n` that both solve. *_solved: shares.
    """
    optimum = [one for one in optima if one is not None]
    both = [(a, b) for a, b in zip(optima, baseline, strict=False) if a is not None and b is not None]
    found = {"optimum_n": len(optima), "optimum_solved": len(optimum) / len(optima), **_spread("optimum", optimum)}
    found |= {"baseline_n": len(baseline), "baseline_solved": len(both) / len(baseline)}
    found |= _spread("baseline", [b for _, b in both])
    found["both_optimum_mean"] = estimates.sample_mean([a for a, _ in both]).mean
    return {name: round(value, 4) for name, value in found.items()}


def _spread(name: str, values: Sequence[int]) -> dict[str, float]:
    """Mean, standard deviation, and the ends of the mean's interval."""
    found = estimates.sample_mean(values)
    return {f"{name}_{what}": getattr(found, what) for what in ("mean", "sd", "low", "high")}


def paper(board: str, obstacles: int) -> Row:
    """Means and sds of the paper's Table 2 or 3."""
    table = paper_table(f"rearrangements_{board}")
    table = table[table.column == str(obstacles)].set_index("method")
    return {f"paper_{method}_{what}": table[what][method] for method in ("dqn", "baseline") for what in ("mean", "sd")}


if __name__ == "__main__":
    sys.exit(run(main, Options))
