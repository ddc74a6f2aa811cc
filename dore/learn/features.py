"""A network's observation of a board, and mirror images to learn from.

B denotes the batch, G the cells, W the words of a board.
"""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor
from torch.nn.functional import pad

from dore.learn.corridor_features import corridor_planes
from dore.world import board as boards
from dore.world.kernels.corridor_costs import N_PLANES
from dore.world.mirror import mirrored_board, mirrored_cell, mirrored_moves
from dore.world.reach import Reach

Encoding = Literal["planes", "state", "lanes"]
"""`state`: the paper's vector of 0, 1 and 2 (eq. 7); `planes`: one plane for the obstacles, one for the
target; `lanes`: these and the approach-corridor costs of `dore.learn.corridor_features`, which mean the same on every
layout (the name is that of earlier versions, so that their configs and models load)."""


def encode(reach: Reach, board: Tensor, target: Tensor, mask: Tensor | None, encoding: Encoding) -> Tensor:
    """Float[B, C, G] of Int64[B, W] boards, Int64[B] targets and, where given, Bool[B, G] masks (eqs. 10, 15)."""
    if encoding == "state":
        planes = [boards.state(board, target, reach.n_cells)]
    else:
        cell = torch.arange(reach.n_cells, device=board.device)
        planes = [boards.unpack(board, reach.n_cells).float(), (cell == target[:, None]).float()]
    if mask is not None:
        planes.append(mask.float())
    observation = torch.stack(planes, 1)
    return torch.cat([observation, corridor_planes(reach, board, target)], 1) if encoding == "lanes" else observation


def n_planes(encoding: Encoding, with_mask: bool) -> int:
    """C of `encode`."""
    return {"state": 1, "planes": 2, "lanes": 2 + N_PLANES}[encoding] + with_mask


def mirrored_by_chance(
    reach: Reach, board_list: list[Tensor], cell_list: list[Tensor], *tables: Tensor
) -> tuple[list[Tensor], ...]:
    """Boards Int64[B, W], cells Int64[B] and tables [B, G, G] of moves, with about half of the rows mirrored."""
    rows = torch.rand(len(board_list[0]), device=reach.device) < 0.5
    return (
        [torch.where(rows[:, None], mirrored_board(board, reach), board) for board in board_list],
        [torch.where(rows, mirrored_cell(cell, reach), cell) for cell in cell_list],
        [torch.where(rows[:, None, None], mirrored_moves(table, reach), table) for table in tables],
    )


def slots(board: Tensor, n_slots: int, n_cells: int) -> tuple[Tensor, Tensor]:
    """The paper's list of obstacles O (section 5.1): cells ascending, one slot each.

    Returns:
        Int64[B, Z] cells, 0 where a slot is absent, and Bool[B, Z], which slots exist. Obstacles past Z
        have no slot.
    """
    cell = torch.arange(n_cells, device=board.device)
    cells = torch.where(boards.unpack(board, n_cells), cell, n_cells)
    cells = cells.topk(min(n_slots, n_cells), largest=False).values
    cells = pad(cells, (0, n_slots - cells.shape[1]), value=n_cells)
    exists = cells < n_cells
    return cells * exists, exists


def slot_of(board: Tensor, cell: Tensor, n_cells: int) -> Tensor:
    """Int64[B]: the slot of the obstacle on each cell, that is, how many obstacles stand on lower cells."""
    lower = torch.arange(n_cells, device=board.device) < cell[:, None]
    return (boards.unpack(board, n_cells) & lower).sum(-1)
