"""The paper's graph search (section 6.1, Fig. 5), which Table 1 compares the network with, compiled."""

from __future__ import annotations

import math

from dore.errors import number, whole
from dore.planners.compiled import Compiled
from dore.world.kernels.breadth_first import breadth_first
from dore.world.kernels.slices import Limits
from dore.world.reach import Reach


class GraphSearch(Compiled):
    """Breadth-first search over boards, a node and a branch at a time.

    As in the paper: a node is a board; branching b_p over which obstacle to pick gives an intermediate node, and
    branching b_l from there over where to place gives the next nodes. The modified VFH+ (`Reach`) is asked whether
    the hand gets to the obstacle, to the place, and, when a node is made, to the target. It ends at the first node
    where the target is accessible.

    Not in the paper, which names neither the order nor what becomes of a board that is reached twice:
    - breadth-first, the plain reading of "until no more branching is necessary": the plan has the fewest moves;
    - a board that was made before is not made again, so the search ends even where there is no plan, and no plan
      goes back;
    - obstacles and places are taken in the order of their cells.

    Args:
        max_nodes: gives up after making this many nodes; each takes some 60 bytes.
        max_seconds: gives up after this many CPU seconds on an instance.

    Raises:
        InputError: a budget of zero or below.
    """

    name = "graph_search"
    kernel = staticmethod(breadth_first)

    def __init__(self, reach: Reach, max_nodes: int, max_seconds: float) -> None:
        limits = Limits(
            seconds=number("planners.graph_search.max_seconds", max_seconds, above=0.0, at_most=1e7),
            nodes=whole("planners.graph_search.max_nodes", max_nodes, 1),
            megabytes=math.inf,
        )
        super().__init__(reach, limits)
