"""What may guide a search: a value for each pick, and for each place of a lifted obstacle; higher is better.

Probabilities are softmaxes of them, so only differences within a row matter. N denotes boards, G the cells, W
the words of a board.
"""

from __future__ import annotations

import os
from typing import Literal, Protocol

import torch
from torch import Tensor

from dore.errors import number, one_of, seed_of
from dore.learn.agents.common import Agent
from dore.learn.corridor_features import corridor_costs
from dore.planners.learned import Learned
from dore.world.reach import Reach
from dore.world.rules import lift

Values = Literal["network", "costs", "random"]
"""What ranks moves: a model's networks, the corridor costs, or a random order."""


class Prior(Protocol):
    """Values of moves on Int64[N, W] boards with Int64[N] targets; those of illegal moves mean nothing."""

    def pick_values(self, board: Tensor, target: Tensor) -> Tensor:
        """Float[N, G]: of picking from each cell."""

    def place_values(self, board: Tensor, target: Tensor, pick: Tensor) -> Tensor:
        """Float[N, G]: of placing what stands on Int64[N] cells on each cell."""


class NetworkPrior:
    """A trained agent's. Q-values are no logits of probabilities, so they are divided by a temperature."""

    def __init__(self, agent: Agent, temperature: float) -> None:
        self.agent, self.temperature = agent, temperature

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
    """A random order."""

    def __init__(self, reach: Reach, seed: int) -> None:
        self.n_cells = reach.n_cells
        self.generator = torch.Generator().manual_seed(seed)

    def pick_values(self, board: Tensor, target: Tensor) -> Tensor:
        """Float[N, G]."""
        return torch.rand(len(board), self.n_cells, generator=self.generator)

    def place_values(self, board: Tensor, target: Tensor, pick: Tensor) -> Tensor:
        """Float[N, G]."""
        return self.pick_values(board, target)


def prior_of(
    options: str,
    reach: Reach,
    values: Values,
    model: str | os.PathLike[str] | None,
    temperature: float,
    seed: int,
) -> Prior:
    """The prior that a planner's options ask for; `options` is their place in the config, named in errors.

    Raises:
        InputError: what `Learned` raises, or a value outside its domain.
    """
    one_of(f"{options}.values", values, Values)
    temperature = number(f"{options}.temperature", temperature, above=0.0, at_most=1e6)
    seed = seed_of(f"{options}.seed", seed)
    if values == "network":
        return NetworkPrior(Learned(reach, model, max_moves=1).agent, temperature)
    return CostPrior(reach) if values == "costs" else RandomPrior(reach, seed)
