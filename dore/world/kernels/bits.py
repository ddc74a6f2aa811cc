"""Boards inside compiled code: tuples of W uint64 words, 64 cells a word, as `dore.world.board` lays them out.

W is known when a kernel is compiled, so that the loops here unroll and a board stays in registers. Each kernel is
compiled once for each W that is used: 1 up to 64 cells, 2 up to 128, and so on. In tables and stores a board is a row
of uint64[..., W].
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numba import config
from numba.cpython.unsafe.tuple import tuple_setitem

from dore.world.kernels.compiling import kernel

Word = np.uint64
Board = tuple[np.uint64, ...]
"""W words."""
Words = np.ndarray[Any, np.dtype[np.uint64]]
"""uint64[W]: a board in a table."""

ZERO, ONE = Word(0), Word(1)
_ODD, _PAIRS, _HALVES, _BYTES = (Word(int(8 * pair, 16)) for pair in ("55", "33", "0F", "01"))
_GOLDEN, _MIXED = Word(0x9E3779B97F4A7C15), Word(0xD6E8FEB86659FD93)

if TYPE_CHECKING or config.DISABLE_JIT:

    def put(board: Board, w: int, word: Word) -> Board:
        """The board with another word w."""
        return (*board[:w], word, *board[w + 1 :])

    def ones(word: Word) -> int:
        """How many bits of a word are set."""
        return int(word).bit_count()

    def hashed(board: Board) -> Word:
        """A number for a board, its high bits well mixed."""
        return Word(hash(board) & (1 << 64) - 1)

else:
    put = tuple_setitem

    @kernel
    def ones(word):
        """How many bits of a word are set (LLVM makes one instruction of it)."""
        word = word - ((word >> ONE) & _ODD)
        word = (word & _PAIRS) + ((word >> Word(2)) & _PAIRS)
        word = (word + (word >> Word(4))) & _HALVES
        return np.int64((word * _BYTES) >> Word(56))

    @kernel
    def hashed(board):
        """A number for a board, its high bits well mixed."""
        found = ZERO
        for word in board:
            found = (found ^ word) * _GOLDEN
            found ^= found >> Word(32)
        return found * _MIXED


@kernel
def row(words: Words, like: Board) -> Board:
    """The board in uint64[W]; like: any board of W words."""
    for w in range(len(like)):
        like = put(like, w, words[w])
    return like


@kernel
def write(words: Words, board: Board) -> None:
    """Put a board into uint64[W]."""
    for w in range(len(board)):
        words[w] = board[w]


@kernel
def same(words: Words, board: Board) -> bool:
    """Whether uint64[W] holds that board."""
    for w in range(len(board)):
        if words[w] != board[w]:
            return False
    return True


@kernel
def union(a: Board, b: Board) -> Board:
    """Cells set on either."""
    for w in range(len(a)):
        a = put(a, w, a[w] | b[w])
    return a


@kernel
def both(a: Board, b: Board) -> Board:
    """Cells set on both."""
    for w in range(len(a)):
        a = put(a, w, a[w] & b[w])
    return a


@kernel
def minus(a: Board, b: Board) -> Board:
    """Cells set on the first alone."""
    for w in range(len(a)):
        a = put(a, w, a[w] & ~b[w])
    return a


@kernel
def nothing(like: Board) -> Board:
    """The board with no cell set."""
    for w in range(len(like)):
        like = put(like, w, ZERO)
    return like


@kernel
def some(board: Board) -> bool:
    """Whether any cell is set."""
    for w in range(len(board)):
        if board[w] != ZERO:
            return True
    return False


@kernel
def meets(a: Board, b: Board) -> bool:
    """Whether any cell is set on both."""
    for w in range(len(a)):
        if a[w] & b[w] != ZERO:
            return True
    return False


@kernel
def count(board: Board) -> int:
    """How many cells are set."""
    found = 0
    for w in range(len(board)):
        found += ones(board[w])
    return found


@kernel
def has(board: Board, cell: int) -> bool:
    """Whether that cell is set."""
    return board[cell >> 6] >> Word(cell & 63) & ONE != ZERO


@kernel
def bit(cell: int, like: Board) -> Board:
    """The board with that one cell set."""
    for w in range(len(like)):
        like = put(like, w, ONE << Word(cell & 63) if cell >> 6 == w else ZERO)
    return like


@kernel
def first(board: Board) -> int:
    """The lowest cell that is set; -1: none."""
    for w in range(len(board)):
        if board[w] != ZERO:
            return 64 * w + ones(~board[w] & (board[w] - ONE))
    return -1


@kernel
def rest(board: Board) -> Board:
    """The board without its lowest cell."""
    for w in range(len(board)):
        if board[w] != ZERO:
            return put(board, w, board[w] & (board[w] - ONE))
    return board
