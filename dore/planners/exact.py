"""The fewest rearrangements, proved: A* over boards, compiled."""

from __future__ import annotations

from dore.errors import number, whole
from dore.planners.compiled import Compiled
from dore.world.kernels.search import search
from dore.world.kernels.slices import Limits
from dore.world.reach import Reach


class Exact(Compiled):
    """A* (Hart, Nilsson and Raphael, 1968) over boards, with a proof either way.

    Unit costs; the bound is that of the delete relaxation (`dore.world.kernels.bound`), at least the fewest obstacles
    on any approach corridor of the target. Boards are expanded in the order of f = moves so far + bound, of equal ones
    those nearest the goal first. Three things keep their number low, and none loses the optimum:

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
    by fewer moves is queued again, so that nothing depends on the bound being consistent. For the same reason an
    instance that is given up has no plan of fewer than f moves, its lower bound.
    Unsolvable: either nothing was left to expand, or the relaxation of the start board has no solution.
    The go-back failure needs no handling: a shortest plan visits no board twice.

    Args:
        max_nodes: gives up on an instance after this many expanded boards.
        max_seconds: gives up on an instance after this many CPU seconds of its own.
        max_memory_mb: gives up on an instance whose boards seen would take more, MiB.

    Raises:
        InputError: a budget of zero or below.
    """

    name = "exact"
    kernel = staticmethod(search)

    def __init__(self, reach: Reach, max_nodes: int, max_seconds: float, max_memory_mb: float) -> None:
        limits = Limits(
            seconds=number("planners.exact.max_seconds", max_seconds, above=0.0, at_most=1e7),
            nodes=whole("planners.exact.max_nodes", max_nodes, 1),
            megabytes=number("planners.exact.max_memory_mb", max_memory_mb, above=0.0, at_most=1e7),
        )
        super().__init__(reach, limits)
