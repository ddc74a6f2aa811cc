"""The fewest rearrangements, proved: A* over boards, many boards and many instances at a time."""

from __future__ import annotations

from dore.errors import number, whole
from dore.planners.astar import Search, SearchLimits
from dore.planners.base import Planner, RawPlan
from dore.planners.bounds import DeleteRelaxation
from dore.planners.visited_set import SeenBoardsFull
from dore.world.problem import Batch
from dore.world.reach import Reach


class Exact(Planner):
    """A* (Hart, Nilsson and Raphael, 1968) over boards, with a proof either way.

    Unit costs; the bound is that of the delete relaxation (`DeleteRelaxation`), at least the fewest obstacles on any
    approach corridor of the target. Boards of equal f = moves so far + bound are expanded as layers of tensors, those
    nearest the goal first. Three things keep the layers thin, and none loses the optimum:

    - Partial expansion (Yoshizumi and others, 2000; Felner and others, 2012). A board is expanded with a budget of
      moves, m = f - moves so far: only moves after which some corridor of the target, open within m, is blocked by at
      most m - 1 obstacles. No other move can begin a plan of m moves, since k obstacles need k moves. The board
      comes back with m + 1 when f has grown, until no move is left out.
    - Lazy bounds (Tolpin and others, 2013): a board is queued by the count of obstacles on its best corridor, and
      the costlier bound is computed only when its turn comes; a board that fails waits for m + 1.
    - An obstacle is not moved twice in a row. Moves p -> q -> r of one obstacle are p -> r: each needs its two cells
      accessible and empty on the same board, the one without the obstacle. So the board after p -> r was one move
      nearer the start, and no shortest plan to it leads through q.

    The goal is seen one move early, when a move may be made after which m - 1 = 0 obstacles block a corridor.

    Optimal: the bounds are admissible, all boards of smaller f have been exhausted before, and a board reached again
    by fewer moves is queued again (`SeenBoards.add`), so that nothing depends on the bound being consistent.
    Unsolvable: either nothing was left to expand, or `DeleteRelaxation.locked` proves it from the start board alone.
    The go-back failure needs no handling: a shortest plan visits no board twice.

    Args:
        max_nodes: gives up on an instance after this many expanded boards.
        max_seconds: gives up on an instance after this many wall seconds of its own; where many are planned together,
            the time of each step is shared out by the boards that each has in it.
        max_memory_mb: what the boards seen may take at a time, MiB. Where instances planned together need more,
            they are planned one by one; one that alone needs more is given up. The step being worked
            on needs some 200 MiB more.

    Raises:
        InputError: a budget of zero or below.
    """

    name = "exact"
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
