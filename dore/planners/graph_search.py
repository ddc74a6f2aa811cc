"""The paper's graph search (section 6.1, Fig. 5), which Table 1 compares the network with."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator

import torch
from torch import Tensor

from dore.errors import number, whole
from dore.planners.base import EXHAUSTED, Planner, RawPlan
from dore.world.board import bit
from dore.world.plan import Status
from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.rules import accessibility, lift, retrievable

Node = tuple[int, ...]
"""A board's words, which the paper calls a state."""
Edge = tuple[Node, int, int]
"""The node that a node was made from, and the move between them: (pick, place) cells, from 0."""


class GraphSearch(Planner):
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
        max_nodes: gives up after making this many nodes; each is kept, in some 400 bytes.
        max_seconds: gives up after this many wall seconds on an instance.

    Raises:
        InputError: a budget of zero or below.
    """

    name = "graph_search"
    group = 1

    def __init__(self, reach: Reach, max_nodes: int, max_seconds: float) -> None:
        self.reach = reach
        self.max_nodes = whole("planners.graph_search.max_nodes", max_nodes, 1)
        self.max_seconds = number("planners.graph_search.max_seconds", max_seconds, above=0.0, at_most=1e7)

    def raw_plans(self, batch: Batch) -> list[RawPlan]:
        """The plan of one instance."""
        board, target = batch
        began = time.perf_counter()
        start: Node = tuple(board[0].tolist())
        made_from: dict[Node, Edge | None] = {start: None}
        goal = start if bool(retrievable(self.reach, board, target)) else None
        waiting = deque([start])
        expansions, spent = 0, ""
        while waiting and goal is None and not spent:
            node = waiting.popleft()
            expansions += 1
            for next_node, pick, place, accessible in self._branches(node, target):
                if next_node in made_from:
                    continue
                made_from[next_node] = (node, pick, place)
                waiting.append(next_node)
                if accessible:
                    goal = next_node
                    break
            spent = self._spent(len(made_from), time.perf_counter() - began)
        seconds = time.perf_counter() - began
        if goal is not None:
            moves = _moves(made_from, goal)
            return [RawPlan(moves, Status.SOLVED, seconds, expansions, len(moves))]
        if waiting:
            return [RawPlan([], Status.GAVE_UP, seconds, expansions, reason=spent)]
        reason = EXHAUSTED.format(len(made_from))
        return [RawPlan([], Status.UNSOLVABLE, seconds, expansions, reason=reason)]

    def _branches(self, node: Node, target: Tensor) -> Iterator[tuple[Node, int, int, bool]]:
        """The next nodes, the move (pick, place) to each, and whether the target is accessible there."""
        board = torch.tensor([node], device=target.device)
        for pick in accessibility(self.reach, board, target).pick.nonzero()[:, 1]:
            intermediate = lift(board, pick[None])
            places = accessibility(self.reach, intermediate, target).place.nonzero()[:, 1]
            boards = intermediate | bit(places, len(node))
            accessible = retrievable(self.reach, boards, target.expand(len(places)))
            for next_board, place, is_goal in zip(boards.tolist(), places.tolist(), accessible.tolist(), strict=True):
                yield tuple(next_board), int(pick), place, is_goal

    def _spent(self, n_nodes: int, seconds: float) -> str:
        """Which budget is spent; empty where none is."""
        if n_nodes >= self.max_nodes:
            return "node budget"
        return "time budget" if seconds >= self.max_seconds else ""


def _moves(made_from: dict[Node, Edge | None], node: Node) -> list[tuple[int, int]]:
    """The moves from the start to a node."""
    moves = []
    while (step := made_from[node]) is not None:
        node, pick, place = step
        moves.append((pick, place))
    return moves[::-1]
