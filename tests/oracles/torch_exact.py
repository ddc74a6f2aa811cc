"""The exact search as it was before it was compiled: A* in tensors, many boards and many instances at a time."""

from __future__ import annotations

from dore.errors import number, whole
from dore.planners.base import Planner, RawPlan
from dore.world.problem import Batch
from dore.world.reach import Reach
from tests.oracles.astar import Search, SearchLimits
from tests.oracles.bounds import DeleteRelaxation
from tests.oracles.visited_set import SeenBoardsFull


class TorchExact(Planner):
    """A* with the budgets of `dore.planners.exact.Exact`, the seconds being wall seconds; it shares no code with it."""

    name = "torch_exact"
    group = 256  # More would not make the tensors any faster.

    def __init__(self, reach: Reach, max_nodes: int, max_seconds: float, max_memory_mb: float) -> None:
        self.reach = reach
        self.limits = SearchLimits(
            nodes=whole("planners.exact.max_nodes", max_nodes, 1),
            seconds=number("planners.exact.max_seconds", max_seconds, above=0.0, at_most=1e7),
            megabytes=number("planners.exact.max_memory_mb", max_memory_mb, above=0.0, at_most=1e7),
        )
        self.relaxation = DeleteRelaxation(reach)

    def raw_plans(self, batch: Batch) -> list[RawPlan]:
        """Plan instances together, and those that do not fit into memory one by one."""
        search = Search(self.reach, self.relaxation, self.limits, batch)
        try:
            search.run()
        except SeenBoardsFull:
            waiting = search.alive.nonzero().squeeze(-1).tolist()
            if len(batch.target) > 1:
                done = search.raw_plans()
                for row in waiting:
                    (done[row],) = self.raw_plans(Batch(batch.board[row, None], batch.target[row, None]))
                return done
            search.give_up(f"memory budget: {search.seen.size} boards seen")
        return search.raw_plans()
