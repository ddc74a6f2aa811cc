"""The corridor costs as they were before they were compiled: in tensors.

Built from the accessibility table alone, so the same numbers mean the same on every layout and reach.
B denotes the batch, L the target corridors that are examined, G the cells, W the words of a board.
"""

from __future__ import annotations

import torch
from torch import Tensor

from dore.learn.corridor_features import Costs
from dore.world import board as boards
from dore.world.reach import Reach

SPARE = 2
"""Approach corridors of the target with more obstacles than this above the fewest are ignored."""
NEVER = 50
"""An infinite cost: a cap above every cost that matters."""
LEVELS = 5
"""Planes of a one-hot cost, one for each whole number; the last stands for more, too."""
N_PLANES = 4 * LEVELS + 2


def corridor_planes(reach: Reach, board: Tensor, target: Tensor) -> Tensor:
    """Float[B, N_PLANES, G] of Int64[B, W] boards and Int64[B] targets: the costs one-hot, and where the cells are."""
    costs = corridor_costs(reach, board, target)
    now = costs.now[:, None].to(torch.int8)
    # A change moves a cost by a few: one better is the first level, as good as now the second.
    relative = [costs.changed - now + 1, costs.blocking - costs.blocking.amin(-1, keepdim=True)]
    levels = torch.stack([*relative, costs.depth, now.expand_as(costs.depth)], 1).clamp(0, LEVELS - 1)
    level = torch.arange(LEVELS, device=board.device, dtype=torch.int8)
    one_hot = (levels[:, :, None] == level[:, None]).flatten(1, 2).float()
    centres = reach.layout.centres.to(board.device, torch.float32) - one_hot.new_tensor([reach.layout.front_m, 0.0])
    return torch.cat([one_hot, centres.T.expand(len(board), -1, -1)], 1)


def corridor_costs(reach: Reach, board: Tensor, target: Tensor) -> Costs:
    """The costs of Int64[B, W] boards and Int64[B] targets."""
    sets = reach.blocking_sets.transpose(0, 1)
    target_bit = boards.bit(target, board.shape[-1])
    occupied = boards.unpack(board, reach.n_cells)
    corridors = sets[target]
    wanted = board[:, None] & corridors
    blocking = boards.count(wanted)
    near = blocking <= blocking.amin(-1, keepdim=True) + SPARE
    # Cells with fewer corridors than others repeat one.
    near[:, 1:] &= ~boards.same(corridors[:, 1:], corridors[:, :-1])
    row, corridor = near.nonzero(as_tuple=True)
    corridors, wanted = corridors[row, corridor], wanted[row, corridor]
    extra, changed_extra = _reaching(reach, board[row], target_bit[row], corridors, wanted)
    count = blocking[row, corridor]
    change = torch.where(occupied, -1, 1).to(torch.int8)
    changed_count = count[:, None].to(torch.int8) + boards.unpack(corridors, reach.n_cells) * change[row]
    everything = torch.full_like(change, NEVER)
    now = torch.full_like(target, NEVER).scatter_reduce(0, row, (count + extra).clamp_max(NEVER), "amin")
    each = row[:, None].expand_as(changed_count)
    changed = everything.scatter_reduce(0, each, (changed_count + changed_extra).clamp_max(NEVER), "amin")
    least = everything.scatter_reduce(0, each, changed_count, "amin")
    standing = boards.unpack(board | target_bit, reach.n_cells).float()
    # A matrix product, because there are many corridors; whole numbers this small are exact in it.
    on_corridors = standing @ _blocking_cells(reach).flatten(0, 1).T.float()
    depth = on_corridors.unflatten(-1, reach.blocking_sets.shape[:2]).amin(1).to(torch.int8)
    return Costs(now, changed, least, depth)


def _blocking_cells(reach: Reach) -> Tensor:
    """Bool[D, G, G]."""
    return boards.unpack(reach.blocking_sets, reach.n_cells)


def _reaching(
    reach: Reach, board: Tensor, target_bit: Tensor, corridors: Tensor, wanted: Tensor
) -> tuple[Tensor, Tensor]:
    """What blocks the hand from the obstacles on corridors of the target: Int64[L], and Int8[L, G] if a cell were
    changed.

    Obstacles of the corridor itself do not count, because they are moved anyway; but the first of them to move needs a
    way on which none of the others stands. An obstacle on a way counts twice if it is not accessible itself.
    """
    n_corridors, sets = len(corridors), reach.blocking_sets.transpose(0, 1)
    others = board & ~corridors
    blocked = others & ~boards.pack(reach.accessible_packed(others | target_bit))
    # How changing a cell changes the ways that it lies on; cells of the corridor itself do not count.
    standing, twice = (boards.unpack(words, reach.n_cells).to(torch.int8) for words in (board, blocked))
    change = 1 - 2 * standing - twice
    change *= ~boards.unpack(corridors, reach.n_cells)
    corridor, cell = boards.unpack(wanted, reach.n_cells).nonzero(as_tuple=True)
    ways = sets[cell]
    closed = (ways & target_bit[corridor, None]).ne(0).any(-1)
    not_first = (ways & wanted[corridor, None]).ne(0).any(-1)
    ways = ways & ~corridors[corridor, None]
    cost = boards.count(ways & others[corridor, None]) + boards.count(ways & blocked[corridor, None])
    cost = cost.masked_fill(closed, NEVER)
    first = cost.masked_fill(not_first, NEVER)
    changed = torch.full((2, len(cell), reach.n_cells), NEVER, dtype=torch.int8, device=board.device)
    costs, change = torch.stack([cost, first]).to(torch.int8), change[corridor]
    for cost_by_way, way in zip(costs.unbind(-1), _blocking_cells(reach), strict=True):
        changed = torch.minimum(changed, cost_by_way[..., None] + way[cell] * change)
    changed = changed.scatter(2, cell[:, None].expand(2, -1, -1), 0).clamp_min(0)
    # Few corridors have more than one obstacle that is not accessible; int16 holds the sums.
    total = torch.zeros(n_corridors, reach.n_cells, dtype=torch.int16, device=board.device)
    total = total.index_add(0, corridor, changed[0].to(torch.int16))
    extra = torch.zeros(n_corridors, dtype=torch.int64, device=board.device).index_add(0, corridor, cost.amin(-1))
    # An empty corridor has no first obstacle.
    empty = boards.count(wanted) == 0
    begin = torch.where(empty, 0, NEVER).scatter_reduce(0, corridor, first.amin(-1), "amin")
    begin_changed = torch.where(empty, 0, NEVER).to(torch.int8)[:, None].repeat(1, reach.n_cells)
    begin_changed = begin_changed.scatter_reduce(0, corridor[:, None].expand_as(changed[1]), changed[1], "amin")
    extra, total = torch.maximum(extra, begin), torch.maximum(total, begin_changed.to(torch.int16))
    return extra.clamp_max(NEVER), total.clamp_max(NEVER).to(torch.int8)
