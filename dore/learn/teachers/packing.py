"""Labels as the replay keeps them: two bits a move.

B denotes the batch, G the cells, P the bytes of a board's labels.
"""

from __future__ import annotations

import torch
from torch import Tensor

_SHIFTS = (0, 2, 4, 6)
NO_LABEL = -1
"""In place of the moves that a move wastes: it is not legal, or has no label."""


def n_bytes(n_cells: int) -> int:
    """P."""
    return -(-n_cells * n_cells // 4)


def packed(wasted: Tensor) -> Tensor:
    """UInt8[B, P] of Int8[B, G, G] moves wasted: 0, 1, 2, or less than 0 where there is no label."""
    flat = (wasted.clamp_min(NO_LABEL) + 1).to(torch.uint8).flatten(1)
    quads = torch.nn.functional.pad(flat, (0, -flat.shape[1] % 4)).unflatten(1, (-1, 4))
    return sum(quads[..., i] << shift for i, shift in enumerate(_SHIFTS))  # type: ignore[return-value]


def unpacked(labels: Tensor, n_cells: int) -> Tensor:
    """Int8[B, G, G] of UInt8[B, P]: moves wasted, or NO_LABEL."""
    quads = torch.stack([labels >> shift & 3 for shift in _SHIFTS], -1)
    return quads.flatten(1)[:, : n_cells * n_cells].unflatten(1, (n_cells, n_cells)).to(torch.int8) - 1
