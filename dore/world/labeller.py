"""Exact labels: the fewest moves of a board, and how many moves each of its moves wastes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from dore.errors import whole
from dore.world.kernels.bound import new_ways
from dore.world.kernels.labels import ILLEGAL, NO_PLAN, UNDECIDED, UNKNOWN, label
from dore.world.kernels.slices import Work
from dore.world.kernels.store import MOST_MOVES, new_store
from dore.world.kernels.tables import unsigned
from dore.world.problem import Batch
from dore.world.reach import Reach

__all__ = ["ILLEGAL", "NO_PLAN", "UNDECIDED", "UNKNOWN", "Labeller", "Labels"]

SMALL_ROOM, LARGE_ROOM = 4096, 1 << 17
"""How many boards a search may store: it begins in the small store, which is quick to clear."""
SLICE = 1 << 14
"""About how many boards are expanded before control returns to Python, which then handles Ctrl-C: some 0.2 s."""


class Labels(NamedTuple):
    """What is known of B boards.

    fewest: Int16[B], the fewest moves to an accessible target; NO_PLAN: proved that there is no plan; UNDECIDED: the
        search gave up, or every plan is longer than `max_moves`.
    wasted: Int8[B, G, G], by how many moves each (pick, place) makes the shortest plan longer: 0, 1 or 2;
        ILLEGAL: the move is not allowed, or the board's fewest moves are not known; UNKNOWN: the search gave up.
    """

    fewest: Tensor
    wasted: Tensor


class Labeller:
    """Finds the labels of boards of one reach, by exact search. The same boards get the same labels everywhere.

    Args:
        max_nodes: gives up on a board, or on the board after a move, once this many are expanded.
        max_moves: the longest plan looked for.
        section: of the config, which has these keys.

    Raises:
        InputError: a number outside its domain.
    """

    def __init__(self, reach: Reach, max_nodes: int, max_moves: int, section: str = "teacher") -> None:
        whole(f"{section}.max_nodes", max_nodes, 1, at_most=10_000_000)
        self.max_moves = whole(f"{section}.max_moves", max_moves, 1, at_most=MOST_MOVES - 1)
        self.reach = reach
        words = reach.n_words
        self._work = Work(
            at=np.zeros(8, np.int64),
            limits=np.array([2**62, max_nodes, LARGE_ROOM, max_moves], np.int64),
            found=np.zeros((1, 6), np.int64),
            moves=np.empty((1, 2 * MOST_MOVES), np.int32),
            is_open=np.empty(reach.table.corridors.shape[1], np.int64),
            clock=np.zeros(2, np.int64),
            ways=new_ways(words),
        )
        n_cells = reach.n_cells
        small = SMALL_ROOM + n_cells * n_cells // 4
        self._stores = new_store(small, words), new_store(max(LARGE_ROOM, 2 * small), words)

    def label(self, batch: Batch, enough: int | None = None) -> Labels:
        """The labels of a batch. After `enough` expanded boards the other rows stay UNDECIDED; None: no limit."""
        n, cells = len(batch.target), self.reach.n_cells
        wasted = np.full((n, cells, cells), ILLEGAL, np.int8)
        fewest = self._run(batch, wasted, enough)
        return Labels(torch.from_numpy(fewest), torch.from_numpy(wasted))

    def fewest(self, batch: Batch) -> Tensor:
        """Int16[B]: the fewest moves of each board, NO_PLAN or UNDECIDED."""
        return torch.from_numpy(self._run(batch, np.empty((0, 1, 1), np.int8), None))

    def _run(self, batch: Batch, wasted: np.ndarray, enough: int | None) -> np.ndarray:
        boards, targets = unsigned(batch.board), batch.target.cpu().numpy()
        fewest = np.full(len(boards), UNDECIDED, np.int16)
        done, left = 0, enough
        while done < len(boards) and (left is None or left > 0):
            part = slice(done, None)
            now = SLICE if left is None else min(SLICE, left)
            rows = wasted[part] if len(wasted) else wasted
            n = label(
                *(self.reach.table, boards[part], targets[part], self.max_moves, now, self._work, *self._stores),
                *(fewest[part], rows),
            )
            done, left = done + n, None if left is None else left - now
        return fewest
