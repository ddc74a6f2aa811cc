"""Plans of every planner, layout and reach before an independent judge, and all small boards against exhaustion.

    python -m tests.trust.plans out=outputs/trust plans=200000

plans/rows.csv: a row a world and planner, with how many plans there were and how many of them are invalid.
proofs/rows.csv: a row a small layout, reach and planner, with how many results exhaustion refutes.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import torch
from hydra import compose, initialize_config_dir
from tqdm import tqdm

from dore.app import build
from dore.errors import InputError, one_of
from dore.files import conf_dir
from dore.planners.base import Planner
from dore.report.measurements import write_measurements
from dore.world.board import pack, unpack
from dore.world.generator import Difficulty, FreshInstances
from dore.world.layout import Layout
from dore.world.plan import Plan
from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.rules import retrievable
from scripts.program import run
from tests.trust.judge import Exhaustion, World, fault

Part = Literal["proofs", "plans"]
GRIDS = ("3x6", "5x5", "6x6", "7x7", "8x8", "9x9", "10x10")
REACHES = ("wide_hand", "paper_fit", "published", "panda_slim", "jaco")
SHARES = {
    "straight_line": 0.45,
    "learned": 0.5,
    "guided": 0.02,
    "exact": 0.02,
    "graph_search": 0.0095,
    "transfer": 0.0005,
}
"""Each planner's share of the plans."""
BUDGETS = (
    *("planners.exact.max_seconds=0.3", "planners.guided.max_seconds=0.3", "planners.transfer.max_seconds=0.3"),
    *("planners.graph_search.max_seconds=0.2", "planners.graph_search.max_nodes=20000"),
)
BATCH = 256
DENSITY = (0.08, 0.5)
"""The share of the cells that obstacles fill, from and to."""
SMALL = ((2, 2), (1, 4), (2, 3), (3, 2), (2, 4), (3, 3), (3, 4))
SMALL_REACHES = ("wide_hand", "paper_fit", "published")
PROVERS = ("exact", "guided", "graph_search")
_RING = [(0.5, -0.28), (0.55, -0.14), (0.57, 0.0), (0.55, 0.14), (0.5, 0.28)]
ARC = Layout(tuple((scale * x, scale * y) for scale in (1.0, 1.25, 1.5) for x, y in _RING), 0.12)
"""Cells on three rings about the robot."""


@dataclass
class Count:
    """What the judge said of one planner's plans in one world."""

    planner: str
    layout: str
    reach: str
    plans: int = 0
    solved: int = 0
    unsolvable: int = 0
    invalid: int = 0
    first_fault: str = ""

    def add(self, plan: Plan, wrong: str | None, where: str) -> None:
        """One plan more."""
        self.plans += 1
        self.solved += plan.status == "solved"
        self.unsolvable += plan.status == "unsolvable"
        if wrong:
            self.invalid += 1
            self.first_fault = self.first_fault or f"{where}: {wrong}"


def worlds() -> Iterator[tuple[str, str, Reach, dict[str, Planner]]]:
    """Every layout under every reach, with its planners."""
    for grid, reach in [*itertools.product(GRIDS, REACHES), ("", "panda")]:
        cfg = _composed([f"layout={grid}"] * bool(grid) + [f"reach={reach}"], SHARES)
        try:
            made = build.reach_of(cfg, "cpu")
        except InputError:
            continue  # A layout that would begin behind the base.
        yield grid or "3x4", reach, made, _planners(cfg, made)
    for reach in SMALL_REACHES:
        cfg = _composed([f"reach={reach}"], SHARES)
        made = build.reach_of(cfg, "cpu", ARC)
        yield "arc", reach, made, _planners(cfg, made)


def judge_plans(plans: int, seed: int) -> list[Count]:
    """About `plans` plans of random boards, by the shares of `SHARES`."""
    counts: list[Count] = []
    everywhere = list(worlds())
    for layout, reach_name, reach, planners in tqdm(everywhere, unit="world"):
        world = World.of_reach(reach)
        for name, planner in planners.items():
            count = Count(name, layout, reach_name)
            counts.append(count)
            wanted = max(1, round(plans * SHARES[name] / len(everywhere)))
            source = _boards(reach, seed)
            while count.plans < wanted:
                batch = source.draw(min(BATCH, wanted - count.plans))
                for (board, target), plan in zip(_cells(reach, batch), planner.plan(batch), strict=True):
                    count.add(plan, fault(world, board, target, _facts(plan)), f"{sorted(board)}, target {target}")
    return counts


def judge_proofs(sizes: tuple[tuple[int, int], ...], seed: int) -> list[Count]:
    """All boards of small layouts whose target is not accessible: is each result what exhaustion finds?"""
    counts: list[Count] = []
    for (rows, cols), reach_name in tqdm(list(itertools.product(sizes, SMALL_REACHES)), unit="world"):
        cfg = _composed([f"reach={reach_name}"], PROVERS)
        reach = build.reach_of(cfg, "cpu", Layout.grid(rows, cols, 0.12, 0.4))
        search = Exhaustion(World.of_reach(reach))
        batch = _every_board(reach)
        if not len(batch.target):
            continue
        fewest = [search.fewest_moves(board, target)[0] for board, target in _cells(reach, batch)]
        for name, planner in _planners(cfg, reach).items():
            count = Count(name, f"{rows}x{cols}", reach_name)
            counts.append(count)
            # The slower planners see every board of the smaller layouts, and a part of the largest.
            step = 1 if name == "exact" or len(fewest) < 3000 else 11
            some = Batch(batch.board[::step], batch.target[::step])
            for (board, target), plan, best in zip(
                _cells(reach, some), planner.plan(some), fewest[::step], strict=True
            ):
                count.add(plan, _refuted(plan, best), f"{sorted(board)}, target {target}")
    return counts


def _refuted(plan: Plan, fewest: int | None) -> str | None:
    """What is wrong with a result where the fewest moves are known; None: nothing."""
    if plan.status == "unsolvable":
        return None if fewest is None else f"unsolvable, and {fewest} moves solve it"
    if plan.status == "solved" and (fewest is None or len(plan.moves) < fewest):
        return f"solved in {len(plan.moves)} moves, the fewest are {fewest}"
    if plan.optimal_moves is not None and plan.optimal_moves != fewest:
        return f"optimum {plan.optimal_moves}, it is {fewest}"
    return None


def _composed(overrides: list[str], planners: Any) -> Any:
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        budgets = [budget for budget in BUDGETS if budget.split(".")[1] in planners]
        return compose("evaluate", [*overrides, f"planner=[{','.join(planners)}]", *budgets])


def _planners(cfg: Any, reach: Reach) -> dict[str, Planner]:
    return {planner.name: planner for planner in build.planners_of(cfg, reach)}


def _boards(reach: Reach, seed: int) -> FreshInstances:
    low, high = (round(share * reach.n_cells) for share in DENSITY)
    return FreshInstances(reach, Difficulty(max(1, low), high), "test", seed)


def _every_board(reach: Reach) -> Batch:
    """Every board whose target is not accessible, with each target."""
    n = reach.n_cells
    bits = (torch.arange(2**n)[:, None] >> torch.arange(n)) & 1
    board = pack(bits.bool()).repeat_interleave(n, 0)
    target = torch.arange(n).repeat(2**n)
    keep = ~bits.bool().flatten()
    board, target = board[keep], target[keep]
    blocked = ~retrievable(reach, board, target)
    return Batch(board[blocked], target[blocked])


def _cells(reach: Reach, batch: Batch) -> list[tuple[frozenset[int], int]]:
    occupied = unpack(batch.board, reach.n_cells)
    return [
        (frozenset(row.nonzero()[:, 0].tolist()), target)
        for row, target in zip(occupied, batch.target.tolist(), strict=True)
    ]


def _facts(plan: Plan) -> dict[str, Any]:
    moves = [(move.pick, move.place, move.pick_direction_deg, move.place_direction_deg) for move in plan.moves]
    return {**asdict(plan), "status": str(plan.status), "moves": moves}


@dataclass(frozen=True)
class Options:
    """out: the folder of the rows; plans: about how many; parts: proofs, plans or both."""

    out: Path
    plans: int = 200_000
    seed: int = 0
    parts: list[str] = field(default_factory=lambda: ["proofs", "plans"])


def main(options: Options) -> None:
    """Judge what is asked for and write the rows."""
    for name in options.parts:
        one_of("parts", name, Part)
    for name in options.parts:
        counts = judge_proofs(SMALL, options.seed) if name == "proofs" else judge_plans(options.plans, options.seed)
        write_measurements(options.out / name, [asdict(count) for count in counts], seed=options.seed)
        wrong = [count for count in counts if count.invalid]
        print(f"{name}: {sum(count.plans for count in counts):,}, invalid: {sum(count.invalid for count in wrong)}")
        for count in wrong:
            print(f"  {count.planner} {count.layout} {count.reach}: {count.first_fault}")


if __name__ == "__main__":
    sys.exit(run(main, Options))
