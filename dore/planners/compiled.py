"""Planners that are a compiled search, and nothing else."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from dore.planners.base import EXHAUSTED, LOCKED, Planner, RawPlan
from dore.world.kernels import slices
from dore.world.kernels.search import search
from dore.world.kernels.slices import Limits
from dore.world.kernels.tables import unsigned
from dore.world.plan import Status
from dore.world.problem import Batch
from dore.world.reach import Reach

STATUS = {slices.SOLVED: Status.SOLVED, slices.UNSOLVABLE: Status.UNSOLVABLE, slices.LOCKED: Status.UNSOLVABLE}
"""Of the outcomes; of all others: gave up."""
REASON = {
    slices.SOLVED: "",
    slices.UNSOLVABLE: EXHAUSTED,
    slices.LOCKED: LOCKED,
    slices.OUT_OF_TIME: "time budget",
    slices.OUT_OF_NODES: "node budget",
    slices.OUT_OF_MEMORY: "memory budget: {} boards seen",
    slices.TOO_LONG: f"more than {slices.MOST_MOVES - 1} moves are needed",
}


class Compiled(Planner):
    """A search over boards by a compiled kernel, one instance after the other."""

    kernel: Callable[..., int]
    group = 4096  # Room for plans is taken for all at once.

    def __init__(self, reach: Reach, limits: Limits) -> None:
        self.reach, self.limits = reach, limits
        # Compiles the kernel, or loads it, so that no plan's time holds that.
        slices.run(self.kernel, reach.table, np.empty((0, reach.n_words), np.uint64), np.empty(0, np.int64), limits)

    def find(self, batch: Batch) -> slices.Found:
        """What is found for many instances, as arrays, unchecked: some 150,000 small ones a second."""
        return slices.run(self.kernel, self.reach.table, unsigned(batch.board), batch.target.cpu().numpy(), self.limits)

    def raw_plans(self, batch: Batch) -> list[RawPlan]:
        """The plans of a batch; the wall time is shared out by the CPU time that each took."""
        began = time.perf_counter()
        found = self.find(batch)
        share = (time.perf_counter() - began) / max(1, int(found.cpu_ns.sum()))
        columns = (found.outcome, found.n_moves, found.expansions, found.seen, found.fewest, found.cpu_ns)
        plans = []
        lists = zip(*(column.tolist() for column in columns), strict=True)
        for row, (outcome, n_moves, expansions, seen, fewest, ns) in enumerate(lists):
            status, cells = STATUS.get(outcome, Status.GAVE_UP), found.moves[row, : 2 * n_moves].tolist()
            plans.append(
                RawPlan(
                    moves=list(zip(cells[::2], cells[1::2], strict=True)),
                    status=status,
                    planning_s=share * ns,
                    expansions=expansions,
                    optimal_moves=n_moves if status is Status.SOLVED else None,
                    reason=REASON[outcome].format(seen),
                    lower_bound=fewest if status is Status.GAVE_UP else None,
                )
            )
        return plans


def glance(reach: Reach, batch: Batch) -> slices.Found:
    """What is known of instances before any search, by `outcome`: SOLVED, the target is accessible, or LOCKED, no plan
    opens it, because what blocks it can never be reached (room may be lacking elsewhere too). `fewest`: the obstacles
    on the target's best corridor; each must be moved, so no plan is shorter.
    """
    limits = Limits(seconds=1e6, nodes=0, megabytes=1024.0)
    return slices.run(search, reach.table, unsigned(batch.board), batch.target.cpu().numpy(), limits)
