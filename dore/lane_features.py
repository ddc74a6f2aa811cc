"""What the lanes say of each cell: how far the target is from free, and what a cell's change would do to that.

Built from the accessibility table alone, so the same numbers mean the same on every layout and reach.
B denotes the batch, L the lanes of all targets that are looked at closer, G the cells, W the words of a board.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from dore import board as boards
from dore.reach import Reach

SPARE = 1
"""Lanes of the target with more obstacles than this above the fewest are not looked at any closer."""
NEVER = 50
"""The cost of what cannot be had; more than any board holds that is worth telling apart."""
LEVELS = 5
"""A cost is shown on so many planes, one a whole number; the last stands for more, too."""
N_PLANES = 4 * LEVELS + 2


class Costs(NamedTuple):
    """Moves that the target is away, as far as two levels of lanes tell: what blocks a lane of the target, and what
    blocks the hand from that.

    now: Int64[B]. changed: Int8[B, G], where the cell were changed, its obstacle gone or a new one there.
    blocking: Int8[B, G], obstacles on the target's best lane, where the cell were changed.
    depth: Int64[B, G], obstacles on a cell's own best lane.
    """

    now: Tensor
    changed: Tensor
    blocking: Tensor
    depth: Tensor


def lane_planes(reach: Reach, board: Tensor, target: Tensor) -> Tensor:
    """Float[B, N_PLANES, G] of Int64[B, W] boards and Int64[B] targets: the costs one-hot, and where the cells are."""
    costs = lane_costs(reach, board, target)
    now = costs.now[:, None].to(torch.int8)
    # A change moves a cost by a few: one better is the first level, as good as now the second.
    relative = [costs.changed - now + 1, costs.blocking - costs.blocking.amin(-1, keepdim=True)]
    absolute = [costs.depth, costs.now[:, None].expand_as(costs.depth)]
    levels = torch.stack([*relative, *absolute], 1).clamp(0, LEVELS - 1)
    shown = (levels[:, :, None] == torch.arange(LEVELS, device=board.device)[:, None]).flatten(1, 2).float()
    where = reach.layout.centres.to(board.device, torch.float32) - shown.new_tensor([reach.layout.front_m, 0.0])
    return torch.cat([shown, where.T.expand(len(board), -1, -1)], 1)


def lane_costs(reach: Reach, board: Tensor, target: Tensor) -> Costs:
    """The costs of Int64[B, W] boards and Int64[B] targets."""
    sets = reach.blocking_sets.transpose(0, 1)
    target_bit = boards.bit(target, board.shape[-1])
    change = torch.where(boards.unpack(board, reach.n_cells), -1, 1).to(torch.int8)
    lanes = sets[target]
    wanted = board[:, None] & lanes
    blocking = boards.count(wanted)
    near = blocking <= blocking.amin(-1, keepdim=True) + SPARE
    # Cells with fewer different lanes than others repeat one.
    near[:, 1:] &= ~boards.same(lanes[:, 1:], lanes[:, :-1])
    row, lane = near.nonzero(as_tuple=True)
    lanes, wanted = lanes[row, lane], wanted[row, lane]
    extra, changed_extra = _reaching(reach, board[row], target_bit[row], lanes, wanted, change[row])
    count = blocking[row, lane]
    changed_count = count[:, None].to(torch.int8) + boards.unpack(lanes, reach.n_cells) * change[row]
    everything = torch.full_like(change, NEVER)
    now = torch.full_like(target, NEVER).scatter_reduce(0, row, count + extra, "amin")
    each = row[:, None].expand_as(changed_count)
    changed = everything.scatter_reduce(0, each, (changed_count + changed_extra).clamp_max(NEVER), "amin")
    least = everything.scatter_reduce(0, each, changed_count, "amin")
    depth = boards.count((board | target_bit)[:, None, None] & sets).amin(-1)
    return Costs(now, changed, least, depth)


def _reaching(
    reach: Reach, board: Tensor, target_bit: Tensor, lanes: Tensor, wanted: Tensor, change: Tensor
) -> tuple[Tensor, Tensor]:
    """What blocks the hand from the obstacles on lanes of the target: Int64[L], and Int8[L, G] where a cell were
    changed. Obstacles of the lane itself do not count, they go anyway. Each argument has one entry a lane."""
    lane, cell = boards.unpack(wanted, reach.n_cells).nonzero(as_tuple=True)
    ways = reach.blocking_sets[:, cell].transpose(0, 1) & ~lanes[lane][:, None]
    closed = (ways & target_bit[lane, None]).ne(0).any(-1)
    cost = boards.count(ways & board[lane, None]).masked_fill(closed, NEVER)
    changed = torch.full((len(cell), reach.n_cells), NEVER, dtype=torch.int8, device=board.device)
    for way, here in zip(ways.unbind(1), cost.to(torch.int8).unbind(1), strict=True):
        changed = torch.minimum(changed, here[:, None] + boards.unpack(way, reach.n_cells) * change[lane])
    changed = changed.scatter(1, cell[:, None], 0)
    extra = torch.zeros(len(lanes), dtype=torch.int64, device=board.device).index_add(0, lane, cost.amin(-1))
    # Few lanes have more than one obstacle that cannot be reached; int16 holds what is added up.
    total = torch.zeros(len(lanes), reach.n_cells, dtype=torch.int16, device=board.device)
    total = total.index_add(0, lane, changed.clamp_min(0).to(torch.int16))
    return extra.clamp_max(NEVER), total.clamp_max(NEVER).to(torch.int8)
