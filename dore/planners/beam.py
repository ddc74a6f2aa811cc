"""Beam search by a prior's log-probabilities, over the boards of many instances at once, a layer a move.

N denotes the boards of a layer, M moves, n the instances, W the words of a board, G the cells.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from dore.errors import whole
from dore.planners.base import RawPlan
from dore.planners.policy import opening_places
from dore.planners.priors import Prior
from dore.world.board import bit
from dore.world.plan import Status
from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.rules import accessibility, lift, retrievable


class Shape(NamedTuple):
    """How much a beam keeps: boards of a layer, picks of a board, and places of a pick, beside the moves that win."""

    width: int
    picks: int
    places: int

    def checked(self, options: str) -> Shape:
        """This shape; `options` is its place in the config.

        Raises:
            InputError: a number outside its domain.
        """
        return Shape(*(whole(f"{options}.{name}", n, 1, at_most=4096) for name, n in self._asdict().items()))


@dataclass
class Search:
    """The state or the result of an instance's search. seconds: CPU; spent: whether its budget is used up."""

    seen: set[tuple[int, ...]]
    expansions: int = 0
    seconds: float = 0.0
    moves: list[tuple[int, int]] | None = None
    spent: bool = False


class _Moves(NamedTuple):
    """Int64[M] boards (as indices), picks and places, Int64[M, W] boards after them, Float[M] log-probabilities."""

    source: Tensor
    pick: Tensor
    place: Tensor
    board: Tensor
    log_p: Tensor


class Beam:
    """One search of each instance, which keeps the most probable boards of every layer, none twice.

    The probability of a move is a softmax over what can be picked times one over where it can be placed; that of a
    board the product along the moves to it. Moves that make the target accessible are all made, however improbable. A
    search ends at the first layer that holds a solution, of several that from the most probable board; or when a layer
    is empty; or when its budget is spent. Plans may be as long as it takes. An instance whose target is accessible at
    the start has a plan of no moves, and is not searched.

    Args:
        start: boards Int64[n, W] and targets Int64[n].
        max_nodes: boards expanded of an instance; max_seconds: CPU seconds of an instance, one for each.
    """

    def __init__(
        self,
        reach: Reach,
        prior: Prior,
        start: Batch,
        shape: Shape,
        max_nodes: Sequence[int],
        max_seconds: Sequence[float],
    ) -> None:
        self.reach, self.prior, self.target, self.shape = reach, prior, start.target, shape
        self.max_nodes, self.max_seconds = max_nodes, max_seconds
        accessible = retrievable(reach, *start).tolist()
        first = zip(start.board.tolist(), accessible, strict=True)
        self.searches = [Search({tuple(board)}, moves=[] if is_open else None) for board, is_open in first]
        self.tree: list[tuple[int, int, int]] = []
        """For every board but the first ones: the index of the one before it, and the move."""
        n, device = len(start.target), start.board.device
        self.board, self.row = start.board, torch.arange(n, device=device)
        self.log_p = torch.zeros(n, device=device)
        self.node = [-1] * n
        self.moved = torch.full((n,), -1, device=device)
        """Int64[N]: where the last obstacle was placed; moving it again at once would waste a move."""
        self._keep([row for row in range(n) if not accessible[row]])

    @torch.inference_mode()
    def run(self) -> list[Search]:
        """Search layer by layer until every instance's search has ended."""
        while len(self.row):
            began = time.thread_time()
            rows = self.row.tolist()
            self._expand()
            each = (time.thread_time() - began) / len(rows)
            for row in rows:
                self.searches[row].expansions += 1
                self.searches[row].seconds += each
            following = Counter(self.row.tolist())
            for row in set(rows):
                search = self.searches[row]
                # A layer that would end too late is not begun: those of large tables take long.
                seconds = search.seconds + each * following[row]
                over = search.expansions >= self.max_nodes[row] or seconds > self.max_seconds[row]
                search.spent = over and search.moves is None
            self._keep([k for k, row in enumerate(self.row.tolist()) if not self.searches[row].spent])
        return self.searches

    def raw_plans(self) -> list[tuple[RawPlan, float]]:
        """`run`: a raw plan of each instance and its CPU seconds, in proportion to which the wall time is divided."""
        began = time.perf_counter()
        searches = self.run()
        share = (time.perf_counter() - began) / max(sum(one.seconds for one in searches), 1e-9)
        return [(self._raw_plan(row, share), one.seconds) for row, one in enumerate(searches)]

    def _raw_plan(self, row: int, share: float) -> RawPlan:
        one = self.searches[row]
        if one.moves is not None:
            return RawPlan(one.moves, Status.SOLVED, share * one.seconds, one.expansions)
        budget = "node budget" if one.expansions >= self.max_nodes[row] else "time budget"
        reason = budget if one.spent else "no new board is left in the beam"
        return RawPlan([], Status.GAVE_UP, share * one.seconds, one.expansions, reason=reason)

    def _expand(self) -> None:
        """The next layer."""
        picks = accessibility(self.reach, self.board, self.target[self.row]).pick
        moves = _Moves(*map(torch.cat, zip(self._winning_moves(picks), self._top_moves(picks), strict=True)))
        row, log_p = self.row[moves.source], self.log_p[moves.source] + moves.log_p
        solves = retrievable(self.reach, moves.board, self.target[row]).tolist()
        order = log_p.argsort(descending=True, stable=True).tolist()
        rows, boards, nodes = row.tolist(), moves.board.tolist(), [self.node[k] for k in moves.source.tolist()]
        steps = list(zip(nodes, moves.pick.tolist(), moves.place.tolist(), strict=True))
        for k in order:
            if solves[k] and self.searches[rows[k]].moves is None:
                self.searches[rows[k]].moves = self._moves_to(steps[k])
        kept, room = [], dict.fromkeys(rows, self.shape.width)
        for k in order:
            search, board = self.searches[rows[k]], tuple(boards[k])
            if search.moves is None and room[rows[k]] and board not in search.seen:
                search.seen.add(board)
                room[rows[k]] -= 1
                kept.append(k)
        self.node = list(range(len(self.tree), len(self.tree) + len(kept)))
        self.tree += [steps[k] for k in kept]
        of_kept = torch.tensor(kept, dtype=torch.int64, device=row.device)
        self.row, self.board, self.log_p = row[of_kept], moves.board[of_kept], log_p[of_kept]
        self.moved = moves.place[of_kept]

    def _top_moves(self, picks: Tensor) -> _Moves:
        """The most probable moves of each board; Bool[N, G] says which obstacles can be picked."""
        board, target = self.board, self.target[self.row]
        cell = torch.arange(self.reach.n_cells, device=board.device)
        allowed = picks & (cell != self.moved[:, None])
        source, pick, first = _best(self.prior.pick_values(board, target), allowed, self.shape.picks)
        board, target = board[source], target[source]
        lifted = lift(board, pick)
        allowed = accessibility(self.reach, lifted, target).place & (cell != pick[:, None])
        pair, place, second = _best(self.prior.place_values(board, target, pick), allowed, self.shape.places)
        after = lifted[pair] | bit(place, lifted.shape[-1])
        return _Moves(source[pair], pick[pair], place, after, first[pair] + second)

    def _winning_moves(self, picks: Tensor) -> _Moves:
        """Every move that makes the target accessible, as the most probable one of its board; picks: Bool[N, G]."""
        source, pick = picks.nonzero(as_tuple=True)
        lifted, target = lift(self.board[source], pick), self.target[self.row][source]
        cell = torch.arange(self.reach.n_cells, device=picks.device)
        places = accessibility(self.reach, lifted, target).place & (cell != pick[:, None])
        pair, place = (places & opening_places(self.reach, lifted, target)).nonzero(as_tuple=True)
        after = lifted[pair] | bit(place, lifted.shape[-1])
        return _Moves(source[pair], pick[pair], place, after, torch.zeros(len(pair), device=picks.device))

    def _keep(self, kept: list[int]) -> None:
        """Drop the other boards of the layer."""
        if len(kept) < len(self.row):
            of_kept = torch.tensor(kept, dtype=torch.int64, device=self.row.device)
            self.node = [self.node[k] for k in kept]
            self.row, self.board, self.log_p = self.row[of_kept], self.board[of_kept], self.log_p[of_kept]
            self.moved = self.moved[of_kept]

    def _moves_to(self, step: tuple[int, int, int]) -> list[tuple[int, int]]:
        """The (pick, place) cells that lead to a board, this step the last."""
        node, *move = step
        moves = [(move[0], move[1])]
        while node >= 0:
            node, pick, place = self.tree[node]
            moves.append((pick, place))
        return moves[::-1]


def _best(values: Tensor, allowed: Tensor, most: int) -> tuple[Tensor, Tensor, Tensor]:
    """Of each row of Float[N, G] the `most` cells of highest value that Bool[N, G] allows: Int64[M] rows and cells, and
    the logarithms of their probabilities, Float[M]."""
    log_p = values.masked_fill(~allowed, -torch.inf).log_softmax(-1)
    top, cells = log_p.topk(min(most, values.shape[-1]), -1)
    row, rank = allowed.gather(-1, cells).nonzero(as_tuple=True)
    return row, cells[row, rank], top[row, rank]
