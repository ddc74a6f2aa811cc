"""Which split a board belongs to: a function of the board alone.

It is the same for a board and its mirror image, which are the same problem. So training can draw fresh boards
for ever, mirrored or not, and never meet one of the test split.
"""

from __future__ import annotations

import torch
from torch import Tensor

from dore.world.board import pack, unpack
from dore.world.reach import Reach

SPLITS = {"train": (0.0, 0.7), "validation": (0.7, 0.85), "test": (0.85, 1.0)}
"""Each split's share of all boards. The paper: 70 % train, 30 % test, and training stops on the test set."""


def split_share(board: Tensor, reach: Reach) -> Tensor:
    """Float64[B]: each board's place in [0, 1), the same for a board and its mirror image (splitmix64)."""
    share = _hash(board)
    if reach.mirror is not None:
        mirrored = unpack(board, reach.n_cells)[:, reach.mirror]
        share = torch.minimum(share, _hash(pack(mirrored)))
    # The lower of two uniform numbers is not uniform: 1 - (1 - u)^2 is.
    return 1 - (1 - share) ** 2 if reach.mirror is not None else share


def _hash(board: Tensor) -> Tensor:
    """Float64[B] in [0, 1) from Int64[B, W]."""
    value = torch.zeros_like(board[:, 0])
    for word in range(board.shape[1]):
        value = value + board[:, word] - 7046029254386353131
        value = (value ^ _shift(value, 30)) * -4658895280553007687
        value = (value ^ _shift(value, 27)) * -7723592293110705685
        value = value ^ _shift(value, 31)
    return _shift(value, 11).double() / 2**53


def _shift(value: Tensor, bits: int) -> Tensor:
    """A logical right shift; torch's own keeps the sign."""
    return (value >> bits) & ((1 << (64 - bits)) - 1)
