"""The boards that a search over many instances has seen, as growing tensors.

N denotes boards given at once, W the words of a board. A row is an instance of the batch.
"""

from __future__ import annotations

import torch
from torch import Tensor

from dore.world.board import WORD, same, unpack

MEBIBYTE = 2**20


class SeenBoardsFull(Exception):
    """The cap on what may be kept would be passed."""


class SeenBoards:
    """Each board of each row once, with the fewest moves it was reached by and the board it was reached from.

    Boards are found by a 64-bit key: sorted runs, each at least twice as long as the next, merged as they grow (a
    log-structured merge tree; O'Neil and others, 1996), so that adding N boards costs a few sorts of about N.
    A key never decides alone, the boards are compared. Where two differing boards share a key, the second may be
    kept twice, which costs time and no proof.

    `board` Int64[C, W], `row`, `parent` (a place, -1 for a start), `moves` and `done` (which the search may use; 0 at
    first, and again where fewer moves turn up), Int64[C] each, hold `size` boards and room for more.

    Args:
        words: W.
        max_megabytes: what the tensors here may take, MiB.
    """

    BYTES_A_BOARD = 8 * (2 + 2 + 1 + 1 + 1 + 1)
    """Kept for each board beside its words: key and place in its run, twice while runs merge; row, parent, moves,
    done."""

    def __init__(self, words: int, max_megabytes: float, device: torch.device) -> None:
        # Growing by half needs the old tensors beside the new ones.
        self.capacity = int(max_megabytes * MEBIBYTE / (self.BYTES_A_BOARD + 8 * words) / 1.5)
        self.size = 0
        self.board = torch.empty(0, words, dtype=torch.int64, device=device)
        self.row, self.parent, self.moves, self.done = torch.empty(4, 0, dtype=torch.int64, device=device)
        self._runs: list[tuple[Tensor, Tensor]] = []

    def add(self, board: Tensor, row: Tensor, parent: Tensor, moves: Tensor) -> Tensor:
        """Keep the boards that are new, or reached by fewer moves than before.

        Args:
            board: Int64[N, W]; row, parent, moves: Int64[N]. Equal boards of a row come with equal moves.

        Returns:
            Int64[M]: the places of those that were kept.

        Raises:
            SeenBoardsFull: they do not fit; nothing has been kept.
        """
        order, first = distinct(board, row)
        board, row, parent, moves = board[order], row[order], parent[order], moves[order]
        key = _key(board, row)
        known = self._find(key, board, row)
        fresh = first & (known < 0)
        n = int(fresh.sum())
        self._grow(n)
        again = (first & (known >= 0)).nonzero().squeeze(-1)
        again = again[moves[again] < self.moves[known[again]]]
        better = known[again]
        self.moves[better], self.parent[better], self.done[better] = moves[again], parent[again], 0
        here = slice(self.size, self.size + n)
        self.board[here], self.row[here] = board[fresh], row[fresh]
        self.parent[here], self.moves[here], self.done[here] = parent[fresh], moves[fresh], 0
        places = torch.arange(self.size, self.size + n, device=key.device)
        self.size += n
        self._remember(key[fresh], places)
        return torch.cat([better, places])

    def count(self, row: int) -> int:
        """How many different boards of a row have been seen."""
        here = slice(self.size)
        return len(self.board[here][self.row[here] == row].unique(dim=0))

    def just_placed(self, place: Tensor) -> Tensor:
        """Int64[N, W]: the obstacle that the move to each board put down; none on a start board."""
        parent = self.parent[place]
        before = self.board[parent.clamp_min(0)]
        return torch.where((parent >= 0)[:, None], self.board[place] & ~before, 0)

    def moves_to(self, place: Tensor) -> list[list[tuple[int, int]]]:
        """The (pick, place) cells of the moves from the start to Int64[N] places; none to place -1."""
        chain = []
        while bool((place >= 0).any()):
            parent = torch.where(place >= 0, self.parent[place.clamp_min(0)], -1)
            after, before = self.board[place.clamp_min(0)], self.board[parent.clamp_min(0)]
            chain.append(torch.stack([_only_cell(before & ~after), _only_cell(after & ~before), parent], -1).tolist())
            place = parent
        steps = reversed(chain)
        moves: list[list[tuple[int, int]]] = [[] for _ in range(len(place))]
        for step in steps:
            for made, (pick, to, parent_place) in zip(moves, step, strict=True):
                if parent_place >= 0:
                    made.append((pick, to))
        return moves

    def _find(self, key: Tensor, board: Tensor, row: Tensor) -> Tensor:
        """Int64[N]: where the boards are kept, -1 where they are not."""
        found = torch.full_like(key, -1)
        for keys, places in self._runs:
            place = places[torch.searchsorted(keys, key).clamp_max(len(keys) - 1)]
            hit = same(self.board[place], board) & (self.row[place] == row)
            found = torch.where(hit, place, found)
        return found

    def _remember(self, key: Tensor, places: Tensor) -> None:
        """A new run, and merges until each is twice as long as the next."""
        if not len(key):
            return
        self._runs.append((key, places))
        while len(self._runs) > 1 and len(self._runs[-2][0]) < 2 * len(self._runs[-1][0]):
            (key_a, places_a), (key_b, places_b) = self._runs[-2:]
            keys, order = torch.cat([key_a, key_b]).sort(stable=True)
            self._runs[-2:] = [(keys, torch.cat([places_a, places_b])[order])]

    def _grow(self, n: int) -> None:
        """Make room for `n` boards more."""
        if self.size + n > self.capacity:
            raise SeenBoardsFull
        room = len(self.row)
        if self.size + n > room:
            more = min(self.capacity, max(self.size + n, room + room // 2, 4096)) - room
            self.board = torch.cat([self.board, self.board.new_empty(more, self.board.shape[1])])
            for name in ("row", "parent", "moves", "done"):
                old = getattr(self, name)
                setattr(self, name, torch.cat([old, old.new_empty(more)]))


def distinct(board: Tensor, row: Tensor) -> tuple[Tensor, Tensor]:
    """Int64[N]: an order, by key, of Int64[N, W] boards and Int64[N] rows; Bool[N]: in it, which are the first of
    their kind. Of equal ones at least one is a first one, and as a rule one only."""
    key, order = _key(board, row).sort(stable=True)
    board, row = board[order], row[order]
    first = torch.ones_like(key, dtype=torch.bool)
    first[1:] = ~same(board[1:], board[:-1]) | (row[1:] != row[:-1])
    return order, first


def _key(board: Tensor, row: Tensor) -> Tensor:
    """Int64[N]: one number for a board of a row; the product wraps round."""
    key = row * -7046029254386353131
    for word in board.unbind(-1):
        key = key * -4417276706812531889 + word
    return key


def _only_cell(board: Tensor) -> Tensor:
    """Int64[N]: the one cell that is set on Int64[N, W] boards."""
    return unpack(board, board.shape[-1] * WORD).long().argmax(-1)
