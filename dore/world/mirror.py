"""The mirror image of a problem about the robot's x axis, which is the same problem again.

B denotes the batch, G the cells, W the words of a board. All raise ValueError where the layout has no mirror image.
"""

from __future__ import annotations

from torch import Tensor

from dore.world.board import pack, unpack
from dore.world.reach import Reach


def mirrored_board(board: Tensor, reach: Reach) -> Tensor:
    """Int64[B, W] boards."""
    return pack(unpack(board, reach.n_cells)[..., _mirror(reach)])


def mirrored_cell(cell: Tensor, reach: Reach) -> Tensor:
    """Int64[...] cells."""
    return _mirror(reach)[cell]


def mirrored_moves(values: Tensor, reach: Reach) -> Tensor:
    """[B, G, G] values of (pick, place)."""
    mirror = _mirror(reach)
    return values[:, mirror][:, :, mirror]


def _mirror(reach: Reach) -> Tensor:
    if reach.mirror is None:
        raise ValueError("this layout has no mirror image")
    return reach.mirror
