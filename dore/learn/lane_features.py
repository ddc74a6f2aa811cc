"""What the lanes say of each cell: how far the target is from free, and what a cell's change would do to that.

Built from the accessibility table alone, so the same numbers mean the same on every layout and reach.
B denotes the batch, L the lanes of all targets that are looked at closer, G the cells, W the words of a board.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from dore.world import board as boards
from dore.world.reach import Reach

SPARE = 2
"""Lanes of the target with more obstacles than this above the fewest are not looked at any closer."""
NEVER = 50
"""The cost of what cannot be had; more than any board holds that is worth telling apart."""
LEVELS = 5
"""A cost is shown on so many planes, one a whole number; the last stands for more, too."""
N_PLANES = 4 * LEVELS + 2


class Costs(NamedTuple):
    """Moves that the target is away, as far as two levels of lanes tell: what blocks a lane of the target, and what
    blocks the hand from that.

    now: Int64[B]. changed: Int8[B, G], where the cell were changed, its obstacle gone or a new one there; which lanes
        are looked at, and what can be reached, is as it is now, so that it is now and then off, mostly too low.
    blocking: Int8[B, G], obstacles on the target's best lane, where the cell were changed.
    depth: Int8[B, G], obstacles on a cell's own best lane, the target being one.
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
    levels = torch.stack([*relative, costs.depth, now.expand_as(costs.depth)], 1).clamp(0, LEVELS - 1)
    level = torch.arange(LEVELS, device=board.device, dtype=torch.int8)
    shown = (levels[:, :, None] == level[:, None]).flatten(1, 2).float()
    where = reach.layout.centres.to(board.device, torch.float32) - shown.new_tensor([reach.layout.front_m, 0.0])
    return torch.cat([shown, where.T.expand(len(board), -1, -1)], 1)


def lane_costs(reach: Reach, board: Tensor, target: Tensor) -> Costs:
    """The costs of Int64[B, W] boards and Int64[B] targets."""
    sets = reach.blocking_sets.transpose(0, 1)
    target_bit = boards.bit(target, board.shape[-1])
    occupied = boards.unpack(board, reach.n_cells)
    lanes = sets[target]
    wanted = board[:, None] & lanes
    blocking = boards.count(wanted)
    near = blocking <= blocking.amin(-1, keepdim=True) + SPARE
    # Cells with fewer different lanes than others repeat one.
    near[:, 1:] &= ~boards.same(lanes[:, 1:], lanes[:, :-1])
    row, lane = near.nonzero(as_tuple=True)
    lanes, wanted = lanes[row, lane], wanted[row, lane]
    extra, changed_extra = _reaching(reach, board[row], target_bit[row], lanes, wanted)
    count = blocking[row, lane]
    change = torch.where(occupied, -1, 1).to(torch.int8)
    changed_count = count[:, None].to(torch.int8) + boards.unpack(lanes, reach.n_cells) * change[row]
    everything = torch.full_like(change, NEVER)
    now = torch.full_like(target, NEVER).scatter_reduce(0, row, (count + extra).clamp_max(NEVER), "amin")
    each = row[:, None].expand_as(changed_count)
    changed = everything.scatter_reduce(0, each, (changed_count + changed_extra).clamp_max(NEVER), "amin")
    least = everything.scatter_reduce(0, each, changed_count, "amin")
    standing = boards.unpack(board | target_bit, reach.n_cells).float()
    # A product of matrices, for there are many lanes; whole numbers this small are exact in it.
    on_lanes = standing @ reach.blocking_cells.flatten(0, 1).T.float()
    depth = on_lanes.unflatten(-1, reach.blocking_sets.shape[:2]).amin(1).to(torch.int8)
    return Costs(now, changed, least, depth)


def _reaching(reach: Reach, board: Tensor, target_bit: Tensor, lanes: Tensor, wanted: Tensor) -> tuple[Tensor, Tensor]:
    """What blocks the hand from the obstacles on lanes of the target: Int64[L], and Int8[L, G] where a cell were
    changed.

    Obstacles of the lane itself do not count, they go anyway; but the first of them to go is reached by a way that
    none of the others stands on. What is on a way counts twice if it cannot be reached itself.
    """
    n_lanes, sets = len(lanes), reach.blocking_sets.transpose(0, 1)
    others = board & ~lanes
    blocked = others & ~boards.pack(reach.free(others | target_bit))
    # What a cell's change does to the ways that it lies on; those of the lane itself do not count.
    standing, twice = (boards.unpack(some, reach.n_cells).to(torch.int8) for some in (board, blocked))
    change = 1 - 2 * standing - twice
    change *= ~boards.unpack(lanes, reach.n_cells)
    lane, cell = boards.unpack(wanted, reach.n_cells).nonzero(as_tuple=True)
    ways = sets[cell]
    closed = (ways & target_bit[lane, None]).ne(0).any(-1)
    not_first = (ways & wanted[lane, None]).ne(0).any(-1)
    ways = ways & ~lanes[lane, None]
    cost = boards.count(ways & others[lane, None]) + boards.count(ways & blocked[lane, None])
    cost = cost.masked_fill(closed, NEVER)
    first = cost.masked_fill(not_first, NEVER)
    changed = torch.full((2, len(cell), reach.n_cells), NEVER, dtype=torch.int8, device=board.device)
    costs, change = torch.stack([cost, first]).to(torch.int8), change[lane]
    for here, way in zip(costs.unbind(-1), reach.blocking_cells, strict=True):
        changed = torch.minimum(changed, here[..., None] + way[cell] * change)
    changed = changed.scatter(2, cell[:, None].expand(2, -1, -1), 0).clamp_min(0)
    # Few lanes have more than one obstacle that cannot be reached; int16 holds what is added up.
    total = torch.zeros(n_lanes, reach.n_cells, dtype=torch.int16, device=board.device)
    total = total.index_add(0, lane, changed[0].to(torch.int16))
    extra = torch.zeros(n_lanes, dtype=torch.int64, device=board.device).index_add(0, lane, cost.amin(-1))
    # A lane that nothing stands on has no first.
    none = boards.count(wanted) == 0
    begin = torch.where(none, 0, NEVER).scatter_reduce(0, lane, first.amin(-1), "amin")
    begin_changed = torch.where(none, 0, NEVER).to(torch.int8)[:, None].repeat(1, reach.n_cells)
    begin_changed = begin_changed.scatter_reduce(0, lane[:, None].expand_as(changed[1]), changed[1], "amin")
    extra, total = torch.maximum(extra, begin), torch.maximum(total, begin_changed.to(torch.int16))
    return extra.clamp_max(NEVER), total.clamp_max(NEVER).to(torch.int8)
