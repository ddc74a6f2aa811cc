"""Q-networks: planes over the cells in, one vector of Q-values a head out.

B denotes the batch, C the planes, G the cells. A network is made by `factory(reach, n_planes, n_outputs)`,
so that one config serves every agent; Hydra supplies the factory (`_partial_: true`).

A network whose weights do not depend on the layout has `serves_every_layout = True` and a method `on(reach)`, which
returns it for another reach with the same parameters, itself where nothing in it depends on the reach.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Protocol

import torch
from torch import Tensor, nn

from dore.errors import InputError, whole
from dore.world.reach import Reach

MAX_WIDTH = 8192
"""No layer is wider."""


class NetworkFactory(Protocol):
    """Makes a network for a reach; `reach.layout` is the layout."""

    def __call__(self, reach: Reach, n_planes: int, n_outputs: Sequence[int]) -> nn.Module:
        """A module Float[B, C, G] -> one Float[B, n] for each n of `n_outputs`."""


class MLP(nn.Module):
    """Fully connected trunk with swish, one linear head an output (paper, Figs. 3-4, Table 5).

    Args:
        widths: nodes of each hidden layer.

    Raises:
        InputError: no hidden layer, or a width below 1.
    """

    def __init__(self, reach: Reach, n_planes: int, n_outputs: Sequence[int], widths: Sequence[int]) -> None:
        super().__init__()
        if not isinstance(widths, list | tuple) or not widths:
            raise InputError(f"network.widths: got {widths!r}, want a list of one hidden layer or more")
        sizes = [n_planes * reach.n_cells, *(whole("network.widths", width, 1, at_most=MAX_WIDTH) for width in widths)]
        layers: list[nn.Module] = [nn.Flatten()]
        for size, width in itertools.pairwise(sizes):
            layers += [nn.Linear(size, width), nn.SiLU()]
        self.trunk = nn.Sequential(*layers)
        self.heads = nn.ModuleList(nn.Linear(sizes[-1], n) for n in n_outputs)

    def forward(self, planes: Tensor) -> tuple[Tensor, ...]:
        """Float[B, C, G] -> Float[B, n] for each head."""
        hidden = self.trunk(planes)
        return tuple(head(hidden) for head in self.heads)


class ConvNet(nn.Module):
    """Residual convolutions over a rectangular layout, with the cells' coordinates as planes of their own.

    A head of G outputs reads each cell's own features; any other head reads all of them (not in the paper,
    whose networks are fully connected).

    Args:
        channels: features of a cell.
        blocks: residual blocks of two 3 x 3 convolutions.

    Raises:
        InputError: a layout that is no rectangle, or a count below 1.
    """

    def __init__(self, reach: Reach, n_planes: int, n_outputs: Sequence[int], channels: int, blocks: int) -> None:
        super().__init__()
        layout = reach.layout
        if layout.grid_shape is None:
            raise InputError("network: conv needs a layout of rows and columns, this one is irregular; want mlp")
        self.shape = layout.grid_shape
        whole("network.channels", channels, 1, at_most=MAX_WIDTH)
        whole("network.blocks", blocks, 1, at_most=100)
        centres = layout.centres.float()
        spread = (centres - centres.mean(0)).abs().amax().clamp_min(1e-6)
        self.register_buffer("coordinates", ((centres - centres.mean(0)) / spread).T.contiguous(), persistent=False)
        self.stem = nn.Conv2d(n_planes + 2, channels, 3, padding=1)
        self.blocks = nn.ModuleList(ResidualBlock(channels) for _ in range(blocks))
        self.heads = nn.ModuleList(_conv_head(channels, math.prod(self.shape), n) for n in n_outputs)

    def forward(self, planes: Tensor) -> tuple[Tensor, ...]:
        """Float[B, C, G] -> Float[B, n] for each head."""
        coordinates = self.get_buffer("coordinates").expand(len(planes), -1, -1)
        hidden = self.stem(torch.cat([planes, coordinates], 1).unflatten(-1, self.shape))
        for block in self.blocks:
            hidden = block(hidden)
        hidden = nn.functional.silu(hidden)
        return tuple(head(hidden) for head in self.heads)


class ResidualBlock(nn.Module):
    """x + conv(swish(conv(swish(x))))."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(channels, channels, 3, padding=1)
        self.second = nn.Conv2d(channels, channels, 3, padding=1)

    def forward(self, x: Tensor) -> Tensor:
        """Float[B, channels, rows, cols], the same shape out."""
        silu = nn.functional.silu
        return x + self.second(silu(self.first(silu(x))))


class CellNet(nn.Module):
    """The same small network for every cell, which also sees the mean and the maximum over all cells.

    Nothing in it depends on how many cells there are or where, so its weights serve every layout (DeepSets, Zaheer
    et al., 2017; not in the paper, whose networks are fully connected). Every head has one output a cell.

    Args:
        width: features of a cell.
        blocks: hidden layers after the first, each with the pooled features of all cells.

    Raises:
        InputError: a head with other outputs than one a cell, or a count below 1.
    """

    serves_every_layout = True

    def __init__(self, reach: Reach, n_planes: int, n_outputs: Sequence[int], width: int, blocks: int) -> None:
        super().__init__()
        if any(n != reach.n_cells for n in n_outputs):
            raise InputError("network: cells has one output a cell, as agent=sequential wants; want mlp or conv here")
        whole("network.width", width, 1, at_most=MAX_WIDTH)
        whole("network.blocks", blocks, 1, at_most=100)
        self.stem = nn.Linear(n_planes, width)
        self.own = nn.ModuleList(nn.Linear(width, width) for _ in range(blocks))
        self.pooled = nn.ModuleList(nn.Linear(2 * width, width) for _ in range(blocks))
        self.heads = nn.ModuleList(nn.Linear(width, 1) for _ in n_outputs)

    def on(self, reach: Reach) -> CellNet:
        """Itself: nothing in it depends on the reach."""
        return self

    def forward(self, planes: Tensor) -> tuple[Tensor, ...]:
        """Float[B, C, G] -> Float[B, G] for each head."""
        hidden = nn.functional.silu(self.stem(planes.transpose(1, 2)))
        for own, pooled in zip(self.own, self.pooled, strict=True):
            everywhere = torch.cat([hidden.mean(1), hidden.amax(1)], -1)
            hidden = hidden + nn.functional.silu(own(hidden) + pooled(everywhere)[:, None])
        return tuple(head(hidden).squeeze(-1) for head in self.heads)


class HeadOf(nn.Module):
    """One head of a network that several share; a plane of ones times the head's number tells it which is asked.

    Args:
        network: Float[B, C + 1, G] -> one Float[B, n] a head.
        head: which.
    """

    def __init__(self, network: nn.Module, head: int) -> None:
        super().__init__()
        self.network, self.head = network, head

    def forward(self, planes: Tensor) -> tuple[Tensor]:
        """Float[B, C, G] -> Float[B, n]."""
        which = planes.new_full((len(planes), 1, planes.shape[-1]), float(self.head))
        return (self.network(torch.cat([planes, which], 1))[self.head],)


def _conv_head(channels: int, n_cells: int, n_outputs: int) -> nn.Module:
    per_cell = nn.Sequential(nn.Conv2d(channels, 1 if n_outputs == n_cells else 4, 1), nn.Flatten())
    return per_cell if n_outputs == n_cells else nn.Sequential(*per_cell, nn.Linear(4 * n_cells, n_outputs))
