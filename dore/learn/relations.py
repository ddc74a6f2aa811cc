"""A network that passes messages along the reach: between cells and the approach corridors that they block.

B denotes the batch, C the planes, G the cells, L the corridors of all cells, H features. Inside, tensors are
Float[G or L, B, H], so that passing messages on is one matrix product for the whole batch.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from dore.errors import InputError, whole
from dore.learn.networks import MAX_WIDTH
from dore.world.reach import Reach

OBSTACLES, TARGET = 0, 1
"""The planes in which an encoding shows them."""
FEW = 8
"""Up to so many boards, one segmented maximum is faster than one maximum a group; it is not used in training."""


class Graph(NamedTuple):
    """Cells and approach corridors as the two sides of a graph. Cells with the same number of corridors are adjacent.

    order: Int64[G], the layout's cells in the graph's order; rank: Int64[G], where each of them is there.
    groups: pairs (number of cells, corridors of each of them), in the graph's order.
    n_corridors: Int64[G], of each cell.
    owner: Int64[L], the cell (in the graph's order) that each corridor leads to.
    blocked_by: Float[L, G], 1 where an obstacle on the cell blocks the corridor.
    blocking: Float[G, L], its transpose, divided by the root of how many corridors a cell blocks on average.
    where: Float[G, 2], metres from the middle of the layout's front.
    """

    order: Tensor
    rank: Tensor
    groups: tuple[tuple[int, int], ...]
    n_corridors: Tensor
    owner: Tensor
    blocked_by: Tensor
    blocking: Tensor
    where: Tensor


def graph_of(reach: Reach) -> Graph:
    """The graph that the reach's table gives, on its device; no corridor in it contains another one of the same cell.

    Raises:
        InputError: the layout has more cells than the kernels hold.
    """
    table, layout, n_cells = reach.table, reach.layout, reach.n_cells
    order = np.argsort(table.n_corridors, kind="stable")
    counts = table.n_corridors[order]
    words = np.concatenate([table.corridors[cell, :n] for cell, n in zip(order, counts, strict=True)])
    bits = np.unpackbits(words.view(np.uint8), axis=1, bitorder="little")[:, :n_cells]
    blocked_by = torch.from_numpy(bits[:, order]).float()
    each = max(float(blocked_by.sum(0).mean()), 1.0)
    cells = torch.from_numpy(order)
    where = (layout.centres - torch.tensor([layout.front_m, 0.0])).float()[cells]
    groups = tuple((len(list(same)), int(n)) for n, same in groupby(counts))
    n_corridors = torch.from_numpy(counts)
    owner = torch.arange(n_cells).repeat_interleave(n_corridors)
    sides = (n_corridors, owner, blocked_by, blocked_by.T.contiguous() / each**0.5, where)
    return Graph(cells.to(reach.device), cells.argsort().to(reach.device), groups, *(t.to(reach.device) for t in sides))


class RelationNet(nn.Module):
    """Messages from cells to the corridors that they block, from a cell's corridors to the cell, and back.

    The value of a cell depends on which corridors it blocks, and where they lead. The reach's table holds this, and the
    network assumes no other geometry, so its weights serve every layout and reach, irregular ones too (not in the
    paper, whose networks are fully connected). A head of G outputs has one a cell. Any other head has one for each
    obstacle, ascending by cell, as `agent=single` wants; a slot without an obstacle has the value of the target's cell.

    Args:
        reach: gives the graph.
        width: H, features of a cell and of a corridor.
        blocks: how often messages are passed.

    Raises:
        InputError: an encoding that does not show obstacles and target apart, or a count below 1.
    """

    serves_every_layout = True

    def __init__(self, reach: Reach, n_planes: int, n_outputs: Sequence[int], width: int, blocks: int) -> None:
        super().__init__()
        if n_planes < 3:
            raise InputError("network: relations wants agent.encoding=planes or lanes, not the paper's state")
        whole("network.width", width, 1, at_most=MAX_WIDTH)
        whole("network.blocks", blocks, 1, at_most=100)
        self.graph = graph_of(reach)
        self.n_outputs = tuple(n_outputs)
        self.per_cell = tuple(n == reach.n_cells for n in n_outputs)
        self.stem = nn.Linear(n_planes + 2, width)
        self.blocks = nn.ModuleList(Messages(width) for _ in range(blocks))
        self.norm = nn.LayerNorm(width)
        self.heads = nn.ModuleList(Head(width) for _ in n_outputs)

    def on(self, reach: Reach) -> RelationNet:
        """This network with the same parameters on another reach."""
        other = copy.copy(self)
        other.graph = graph_of(reach)
        return other

    def forward(self, planes: Tensor) -> tuple[Tensor, ...]:
        """Float[B, C, G] -> Float[B, n] for each head."""
        graph = self.graph
        seen = planes[..., graph.order].permute(2, 0, 1)
        standing = (seen[..., OBSTACLES] + seen[..., TARGET])[..., None]
        target = seen[..., TARGET].argmax(0)
        row = torch.arange(len(planes), device=planes.device)
        hidden = self.stem(torch.cat([seen, graph.where[:, None].expand(-1, len(planes), -1)], -1))
        for block in self.blocks:
            hidden = hidden + block(graph, hidden, standing, target, row)
        hidden = self.norm(hidden)
        everywhere = torch.cat([hidden.amax(0), hidden[target, row]], -1)
        values = [head(hidden, everywhere).T[:, graph.rank] for head in self.heads]
        return tuple(
            value if per_cell else of_slots(planes, value, n)
            for value, per_cell, n in zip(values, self.per_cell, self.n_outputs, strict=True)
        )


class Messages(nn.Module):
    """One round of messages, as what it adds to the features of the cells.

    A corridor gets messages from the objects in it and from the cell that it leads to; a cell from its best corridor,
    since one free corridor is enough, and from every corridor that it blocks; each from the mean, the maximum
    and the target.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.from_standing = nn.Linear(width, width, bias=False)
        self.from_owner = nn.Linear(width, width)
        self.from_corridor = nn.Linear(width, width)
        self.from_best = nn.Linear(width, width, bias=False)
        self.mix = nn.Linear(3 * width, 2 * width)
        self.from_everywhere = nn.Linear(3 * width, 2 * width, bias=False)
        self.out = nn.Linear(2 * width, width)

    def forward(self, graph: Graph, hidden: Tensor, standing: Tensor, target: Tensor, row: Tensor) -> Tensor:
        """Float[G, B, H] -> Float[G, B, H]; standing: Float[G, B, 1]; target: Int64[B] in the graph's order."""
        silu = nn.functional.silu
        n_cells, batch, width = hidden.shape
        hidden = self.norm(hidden)
        owner = self.from_owner(hidden).flatten(1).index_select(0, graph.owner)
        stands = (self.from_standing(hidden) * standing).flatten(1)
        corridor = silu(torch.addmm(owner, graph.blocked_by, stands).view(len(owner), batch, width))
        best = best_corridors(graph, corridor)
        back = silu(self.from_corridor(corridor) + self.from_best(best).index_select(0, graph.owner))
        down = (graph.blocking @ back.flatten(1)).view(n_cells, batch, width)
        everywhere = torch.cat([hidden.mean(0), hidden.amax(0), hidden[target, row]], -1)
        mixed = self.mix(torch.cat([hidden, best, down], -1)) + self.from_everywhere(everywhere)
        out: Tensor = self.out(silu(mixed))
        return out


def best_corridors(graph: Graph, corridor: Tensor) -> Tensor:
    """Float[G, B, H]: the maximum over each cell's corridors Float[L, B, H]; 0 for a cell without one."""
    if 0 < corridor.shape[1] <= FEW and not torch.is_grad_enabled():
        found = torch.segment_reduce(corridor.flatten(1), "max", lengths=graph.n_corridors, axis=0, unsafe=True)
        return found.nan_to_num_(neginf=0.0).view(-1, *corridor.shape[1:])
    parts = corridor.split([cells * corridors for cells, corridors in graph.groups])
    best = [
        part.unflatten(0, (cells, corridors)).amax(1) if corridors else part.new_zeros(cells, *part.shape[1:])
        for part, (cells, corridors) in zip(parts, graph.groups, strict=True)
    ]
    return torch.cat(best)


class Head(nn.Module):
    """The value of each cell."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.own = nn.Linear(width, 2 * width)
        self.from_everywhere = nn.Linear(2 * width, 2 * width, bias=False)
        self.out = nn.Linear(2 * width, 1)

    def forward(self, hidden: Tensor, everywhere: Tensor) -> Tensor:
        """Float[G, B, H], Float[B, 2 H] -> Float[G, B]."""
        mixed = nn.functional.silu(self.own(hidden) + self.from_everywhere(everywhere))
        value: Tensor = self.out(mixed).squeeze(-1)
        return value


def of_slots(planes: Tensor, value: Tensor, n_slots: int) -> Tensor:
    """Float[B, Z]: the Float[B, G] values of the obstacles' cells, ascending; absent slots have the target's."""
    obstacle = planes[:, OBSTACLES] > 0
    cell = torch.arange(value.shape[1], device=value.device)
    cells = torch.where(obstacle, cell, len(cell)).sort(-1).values[:, :n_slots]
    cells = nn.functional.pad(cells, (0, n_slots - cells.shape[1]), value=len(cell))
    return value.gather(1, torch.where(cells < len(cell), cells, planes[:, TARGET].argmax(-1, keepdim=True)))
