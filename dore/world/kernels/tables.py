"""A reach as the kernels take it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dore.errors import InputError

if TYPE_CHECKING:
    from torch import Tensor

MAX_WORDS = 16
"""The most words of a board: 1,024 cells. Compiling takes 6 to 10 s for each number of words, once a machine."""


class Table(NamedTuple):
    """The different approach corridors of each cell, D at most, as the sets of cells that must be empty.

    corridors: uint64[G, D, W]. n_corridors: int64[G], how many of the D there are;
    where there is none, the first of them is the full board.
    full: W words, the board with all cells set.
    """

    corridors: np.ndarray
    n_corridors: np.ndarray
    full: tuple[np.uint64, ...]


def table_of(sets: np.ndarray, reachable: np.ndarray, n_cells: int) -> Table:
    """The table of uint64[D, G, W], for each corridor the cells that block it, of bool[G] cells that have any.

    Raises:
        InputError: more cells than the kernels hold.
    """
    if n_cells > 64 * MAX_WORDS:
        raise InputError(f"layout: got {n_cells:,} cells, want {64 * MAX_WORDS:,} at most, as the kernels hold")
    most, _, words = sets.shape
    corridors = np.zeros((n_cells, most, words), np.uint64)
    n_corridors = np.zeros(n_cells, np.int64)
    for cell, is_reachable in enumerate(reachable.tolist()):
        kept = list(dict.fromkeys(map(tuple, sets[:, cell].tolist())))
        corridors[cell, : len(kept)] = kept
        n_corridors[cell] = len(kept) if is_reachable else 0
    every = (1 << n_cells) - 1
    return Table(corridors, n_corridors, tuple(np.uint64(every >> 64 * w & 2**64 - 1) for w in range(words)))


def unsigned(words: Tensor) -> np.ndarray:
    """Int64 words as the kernels take them: uint64, in one piece, in main memory."""
    return words.cpu().contiguous().numpy().view(np.uint64)
