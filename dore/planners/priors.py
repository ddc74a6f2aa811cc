"""What may lead a search: a value of each pick, and of each place of a lifted obstacle, higher is better.

Softmaxes of them are taken for probabilities, so only differences within a row count. N denotes boards, G the cells, W
the words of a board.
"""

from __future__ import annotations

from typing import Protocol

import torch
from torch import Tensor

from dore.errors import number, seed_of
from dore.learn.agents.common import Agent
from dore.learn.corridor_features import corridor_costs
from dore.world.reach import Reach
from dore.world.rules import lift


class Prior(Protocol):
    """Values of moves on Int64[N, W] boards with Int64[N] targets; of moves that are not legal they mean nothing."""

    def pick_values(self, board: Tensor, target: Tensor) -> Tensor:
        """Float[N, G]: of picking from each cell."""

    def place_values(self, board: Tensor, target: Tensor, pick: Tensor) -> Tensor:
        """Float[N, G]: of placing what stands on Int64[N] cells on each cell."""


class NetworkPrior:
    """A trained agent's. Q-values are no logits of probabilities, so they are divided by a temperature.

    Raises:
        InputError: a temperature of zero or below.
    """

    def __init__(self, agent: Agent, temperature: float) -> None:
        self.agent = agent
        self.temperature = number("planners.guided.temperature", temperature, above=0.0, at_most=1e6)

    def pick_values(self, board: Tensor, target: Tensor) -> Tensor:
        """Float[N, G]."""
        return self.agent.pick_values(board, target) / self.temperature

    def place_values(self, board: Tensor, target: Tensor, pick: Tensor) -> Tensor:
        """Float[N, G]."""
        return self.agent.move_values(board, target, pick) / self.temperature


class CostPrior:
    """By the approach-corridor costs if the cell were emptied, or filled; no network."""

    def __init__(self, reach: Reach) -> None:
        self.reach = reach

    def pick_values(self, board: Tensor, target: Tensor) -> Tensor:
        """Float[N, G]."""
        return -corridor_costs(self.reach, board, target).changed.float()

    def place_values(self, board: Tensor, target: Tensor, pick: Tensor) -> Tensor:
        """Float[N, G]."""
        return -corridor_costs(self.reach, lift(board, pick), target).changed.float()


class RandomPrior:
    """Nothing leads.

    Raises:
        InputError: a bad seed.
    """

    def __init__(self, reach: Reach, seed: int) -> None:
        self.n_cells = reach.n_cells
        self.generator = torch.Generator().manual_seed(seed_of("planners.guided.seed", seed))

    def pick_values(self, board: Tensor, target: Tensor) -> Tensor:
        """Float[N, G]."""
        return torch.rand(len(board), self.n_cells, generator=self.generator)

    def place_values(self, board: Tensor, target: Tensor, pick: Tensor) -> Tensor:
        """Float[N, G]."""
        return self.pick_values(board, target)
