"""Boards as int64 words, 64 cells a word: bit c % 64 of word c // 64 says whether cell c holds an obstacle.

B denotes the batch, G the number of cells, W = ceil(G / 64) the words of a board.
"""

from __future__ import annotations

from functools import cache

import torch
from torch import Tensor

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
