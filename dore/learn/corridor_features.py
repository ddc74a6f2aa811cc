"""Corridor-cost features of each cell: how far the target is from accessible, and what changing the cell would do.

Built from the accessibility table alone, so the same numbers mean the same on every layout and reach. Compiled, on the
CPU: `dore.world.kernels.corridor_costs`. B denotes the batch, G the cells, W the words of a board.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from dore.world.kernels import corridor_costs as kernels
from dore.world.kernels.tables import unsigned
from dore.world.reach import Reach


class Costs(NamedTuple):
    """Estimated moves to the target from two levels of corridors: what blocks a corridor of the target, and what
    blocks the hand from that. Of the corridor itself, obstacles do not count twice, because they are moved anyway; but
    the first of them to move needs a way on which none of the others stands.

    now: Int64[B]. changed: Int64[B, G], if the cell were changed: its obstacle removed, or a new one there. It assumes
        today's corridors and today's accessibility, so it is sometimes wrong, mostly too low.
    blocking: Int64[B, G], obstacles on the target's best corridor, if the cell were changed.
    depth: Int64[B, G], obstacles on a cell's own best corridor, the target being one.
    """

    now: Tensor
    changed: Tensor
    blocking: Tensor
    depth: Tensor


def corridor_planes(reach: Reach, board: Tensor, target: Tensor) -> Tensor:
    """Float[B, N_PLANES, G] of Int64[B, W] boards and Int64[B] targets: the costs one-hot, and where the cells are."""
    centres = reach.layout.centres.float() - torch.tensor([reach.layout.front_m, 0.0])
    planes = torch.empty(len(board), kernels.N_PLANES, reach.n_cells)
    where, room = centres.T.contiguous().numpy(), kernels.new_scratch(reach.table)
    kernels.corridor_planes(reach.table, unsigned(board), target.cpu().numpy(), where, room, planes.numpy())
    return planes.to(board.device)


def corridor_costs(reach: Reach, board: Tensor, target: Tensor) -> Costs:
    """The costs of Int64[B, W] boards and Int64[B] targets."""
    costs = np.empty((len(board), 4, reach.n_cells), np.int16)
    room = kernels.new_scratch(reach.table)
    kernels.corridor_costs(reach.table, unsigned(board), target.cpu().numpy(), room, costs)
    changed, blocking, depth, now = torch.from_numpy(costs).to(board.device, torch.int64).unbind(1)
    return Costs(now[:, 0], changed, blocking, depth)
