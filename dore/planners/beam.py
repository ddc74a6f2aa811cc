"""Beam search over the boards of many instances at once, a layer a move, led by Q-values. `Guided` says the rest.

N denotes the boards of a layer, P pairs of a board and a pick, n the instances, W the words of a board, G the cells.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from dore.planners.visited_set import SeenBoards, SeenBoardsFull
from dore.world.board import bit, unpack
from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.rules import accessibility, lift

MoveValues = Callable[[Tensor, Tensor, Tensor], Tensor]
"""Boards Int64[P, W], targets and picks Int64[P] -> Float[P, G], the value of placing on each cell."""


class Found(NamedTuple):
    """How a search ended, one entry an instance."""

    moves: list[list[tuple[int, int]] | None]
    """(pick, place) cells of a plan, if one was found."""
    narrow: list[bool]
    """Moves were left out because the beam was too narrow, or because time or memory ran out."""
    cut: list[bool]
    """Boards were left whose plans would have been longer than was asked for."""
    expansions: list[int]
    """Boards whose moves were generated."""
    boards: list[int]
    """Different boards seen."""
    full: list[bool]
    """The search ended because memory ran out."""


class Beam:
    """One search of some instances, which keeps the `width` most promising moves of each in every layer.

    Args:
        start: boards and targets of instances whose target is not accessible.
        max_moves: Int64[n]: the longest plan that is looked for.
        max_megabytes: what the boards seen may take, MiB; a search that needs more ends there.
        until: when to end, by `time.perf_counter`.
    """

    def __init__(
        self,
        reach: Reach,
        values: MoveValues,
        start: Batch,
        width: int,
        max_moves: Tensor,
        max_megabytes: float,
        until: float,
    ) -> None:
        self.reach, self.values, self.target = reach, values, start.target
        self.width, self.max_moves, self.until = width, max_moves, until
        n, device = len(start.target), start.board.device
        self.seen = SeenBoards(start.board.shape[-1], max_megabytes, device)
        row = torch.arange(n, device=device)
        self.layer = self.seen.add(start.board, row, torch.full_like(row, -1), torch.zeros_like(row))
        self.full = False
        self.narrow, self.cut = torch.zeros(2, n, dtype=torch.bool, device=device)
        self.expansions = torch.zeros(n, dtype=torch.int64, device=device)
        self.parent = torch.full((n,), -1, dtype=torch.int64, device=device)
        """Of solved instances, where `seen` keeps the board before the last move."""
        self.last = torch.zeros(n, 2, dtype=torch.int64, device=device)
        """Their last move."""

    @torch.no_grad()
    def run(self) -> Found:
        """Search layer by layer until every instance is solved, exhausted or out of moves, time or memory."""
        while len(self.layer):
            row = self.seen.row[self.layer]
            unsolved = self.parent[row] < 0
            in_length = self.seen.moves[self.layer] < self.max_moves[row]
            self.cut[row[unsolved & ~in_length]] = True
            self.layer = self.layer[unsolved & in_length]
            try:
                self._expand()
            except SeenBoardsFull:
                self.full = True
                break
            if time.perf_counter() >= self.until:
                break
        row = self.seen.row[self.layer]
        self.narrow[row[self.parent[row] < 0]] = True
        return self._found()

    def _found(self) -> Found:
        solved, last = (self.parent >= 0).tolist(), self.last.tolist()
        moves = [
            [*before, (pick, place)] if one else None
            for before, (pick, place), one in zip(self.seen.moves_to(self.parent), last, solved, strict=True)
        ]
        boards = self.seen.row[: self.seen.size].bincount(minlength=len(solved)).tolist()
        full = [self.full and one is None for one in moves]
        return Found(moves, self.narrow.tolist(), self.cut.tolist(), self.expansions.tolist(), boards, full)

    def _expand(self) -> None:
        """The next layer; instances that a last move solves leave the search."""
        board, row = self.seen.board[self.layer], self.seen.row[self.layer]
        self.expansions.index_add_(0, row, torch.ones_like(row))
        pick = accessibility(self.reach, board, self.target[row]).pick & ~unpack(
            self.seen.just_placed(self.layer), self.reach.n_cells
        )
        source, cell = pick.nonzero(as_tuple=True)
        row, target = row[source], self.target[row[source]]
        lifted = lift(board[source], cell)
        place = accessibility(self.reach, lifted, target).place & ~unpack(board[source], self.reach.n_cells)
        self._finish(place & self._opens(lifted, target), self.layer[source], cell, row)
        # Only the order of those that continue is asked of the network, which is most of the work.
        going = (self.parent[row] < 0).nonzero().squeeze(-1)
        if not len(going):
            self.layer = self.layer[:0]
            return
        source, cell, row, lifted, place = (of_pair[going] for of_pair in (source, cell, row, lifted, place))
        values = self.values(board[source], self.target[row], cell)
        pair, to = place.nonzero(as_tuple=True)
        best = self._best(values[pair, to], row[pair])
        pair, to = pair[best], to[best]
        after = lifted[pair] | bit(to, lifted.shape[-1])
        parent = self.layer[source[pair]]
        self.layer = self.seen.add(after, row[pair], parent, self.seen.moves[parent] + 1)

    def _opens(self, lifted: Tensor, target: Tensor) -> Tensor:
        """Bool[P, G]: cells on which a lifted obstacle leaves the target accessible."""
        corridors = self.reach.blocking_sets[:, target]
        free = (lifted & corridors).eq(0).all(-1)
        opens = torch.zeros(len(target), self.reach.n_cells, dtype=torch.bool, device=lifted.device)
        for corridor, is_open in zip(corridors, free, strict=True):
            opens |= is_open[:, None] & ~unpack(corridor, self.reach.n_cells)
        return opens

    def _finish(self, opens: Tensor, parent: Tensor, pick: Tensor, row: Tensor) -> None:
        """End the instances that a Bool[P, G] move solves, by the first of these."""
        some = opens.any(-1).nonzero().squeeze(-1)
        some = some[row[some].argsort(stable=True)]
        first = torch.ones_like(some, dtype=torch.bool)
        first[1:] = row[some[1:]] != row[some[:-1]]
        some = some[first]
        self.parent[row[some]] = parent[some]
        self.last[row[some]] = torch.stack([pick[some], opens[some].long().argmax(-1)], -1)

    def _best(self, values: Tensor, row: Tensor) -> Tensor:
        """Which moves are kept: of each row the `width` most valued."""
        order = values.argsort(descending=True, stable=True)
        order = order[row[order].argsort(stable=True)]
        per_row = row.bincount(minlength=len(self.narrow))
        rank = torch.arange(len(row), device=row.device) - (per_row.cumsum(0) - per_row)[row[order]]
        self.narrow |= per_row > self.width
        return order[rank < self.width]
