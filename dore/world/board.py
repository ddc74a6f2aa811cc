"""Boards as int64 words, 64 cells a word: bit c % 64 of word c // 64 says whether cell c holds an obstacle.

B denotes the batch, G the number of cells, W = ceil(G / 64) the words of a board.
"""

from __future__ import annotations

from functools import cache

import torch
from torch import Tensor

from dore.errors import InputError, shown

WORD = 64


def n_words(n_cells: int) -> int:
    """W: how many int64 words hold `n_cells` cells."""
    return -(-n_cells // WORD)


@cache
def _bits(device: torch.device) -> Tensor:
    """Int64[64]: each bit of a word."""
    return torch.ones((), dtype=torch.int64, device=device) << torch.arange(WORD, device=device)


def pack(occupied: Tensor) -> Tensor:
    """Bool[..., G] -> Int64[..., W]."""
    bits = _bits(occupied.device)
    words = [(part * bits[: part.shape[-1]]).sum(-1) for part in occupied.split(WORD, -1)]
    return torch.stack(words, -1)


def unpack(board: Tensor, n_cells: int) -> Tensor:
    """Int64[..., W] -> Bool[..., G]."""
    cell = torch.arange(min(WORD, n_cells), device=board.device)
    words = [((word[..., None] >> cell) & 1).bool() for word in board.unbind(-1)]
    # Word by word: gathering each cell's word first takes several times as long.
    return words[0] if len(words) == 1 else torch.cat(words, -1)[..., :n_cells]


def bit(cell: Tensor, words: int) -> Tensor:
    """Int64[...] cells -> Int64[..., W]: a board with that one cell set."""
    word = torch.arange(words, device=cell.device)
    one = torch.ones_like(cell) << (cell % WORD)
    return torch.where((cell // WORD)[..., None] == word, one[..., None], 0)


def contains(board: Tensor, cell: Tensor) -> Tensor:
    """Bool[...]: whether Int64[..., W] boards hold something on Int64[...] cells."""
    word = board.gather(-1, (cell // WORD)[..., None]).squeeze(-1)
    return ((word >> (cell % WORD)) & 1).bool()


def count(board: Tensor) -> Tensor:
    """Int64[...]: how many cells of Int64[..., W] are set, by halves (Hacker's Delight, section 5-1)."""
    x = board - ((board >> 1) & 0x5555555555555555)
    x = (x & 0x3333333333333333) + ((x >> 2) & 0x3333333333333333)
    x = (x + (x >> 4)) & 0x0F0F0F0F0F0F0F0F
    x = x + (x >> 8)
    x = x + (x >> 16)
    x = (x + (x >> 32)) & 0x7F
    return x[..., 0] if x.shape[-1] == 1 else x.sum(-1)


def state(board: Tensor, target: Tensor, n_cells: int) -> Tensor:
    """Float[B, G]: the paper's state vector, eq. 7: 0 empty, 1 obstacle, 2 target."""
    cell = torch.arange(n_cells, device=board.device)
    return unpack(board, n_cells).float() + 2.0 * (cell == target[..., None]).float()


def same(a: Tensor, b: Tensor) -> Tensor:
    """Bool[...]: whether Int64[..., W] boards are equal (the leading shapes broadcast)."""
    return (a == b).all(-1)


def integers(name: str, values: object, device: torch.device) -> Tensor:
    """A copy of integers of any width, of torch or NumPy, as Int64.

    Raises:
        InputError: they are something else.
    """
    if not hasattr(values, "dtype"):
        raise InputError(f"{name}: got {shown(values)}, want an array of integers")
    found = torch.as_tensor(values)
    if found.is_floating_point() or found.is_complex() or found.dtype == torch.bool:
        raise InputError(f"{name}: got {found.dtype}, want integers")
    return found.to(device, torch.int64, copy=True)


def check_boards(name: str, board: Tensor, target: Tensor, n_cells: int) -> None:
    """Refuse what are no boards Int64[N, W] and targets Int64[N] of a layout of `n_cells`.

    Raises:
        InputError: another shape, cells off the board, or a target among the obstacles; names the first one.
    """
    words = n_words(n_cells)
    if target.ndim != 1 or board.shape != (len(target), words):
        raise InputError(
            f"{name}: got boards {list(board.shape)} and targets {list(target.shape)}, want [N, {words}] and [N]"
        )
    on_board = (target >= 0) & (target < n_cells)
    faults = {
        "an obstacle off the board": count(board) != unpack(board, n_cells).sum(-1),
        "a target off the board": ~on_board,
        "the target among the obstacles": contains(board, torch.where(on_board, target, 0)),
    }
    refuse_first(name, faults)


def refuse_first(name: str, faults: dict[str, Tensor]) -> None:
    """Nothing, unless a row of Bool[N] is true.

    Raises:
        InputError: names the first such row, and what it has.
    """
    for why, broken in faults.items():
        if bool(broken.any()):
            raise InputError(f"{name}: number {int(broken.nonzero()[0, 0]) + 1} has {why}")
