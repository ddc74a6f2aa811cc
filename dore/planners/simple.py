"""Policies without a network, for comparison: random moves, winning moves, and one step of lookahead."""

from __future__ import annotations

import torch
from torch import Tensor

from dore.errors import seed_of
from dore.learn.corridor_features import corridor_costs
from dore.planners.policy import Policy, legal_pairs, random_move, winning_else
from dore.world.board import bit
from dore.world.episode import Episodes
from dore.world.reach import Reach
from dore.world.rules import retrievable


class Random(Policy):
    """A random legal pick, and a random legal place for it.

    Args:
        seed: of the choices; the others: see `Policy`.
    """

    name = "random"

    def __init__(self, reach: Reach, max_moves: int, max_nodes: int, max_seconds: float, seed: int) -> None:
        super().__init__(reach, max_moves, max_nodes, max_seconds)
        self.seed = seed_of(f"planners.{self.name}.seed", seed)

    def choose(self, episodes: Episodes, number: int) -> tuple[Tensor, Tensor]:
        """A random legal move."""
        return random_move(self.reach, episodes, self.seed, number)


class WinElseRandom(Random):
    """A move that makes the target accessible, if there is one; else as `Random`."""

    name = "win_else_random"

    def choose(self, episodes: Episodes, number: int) -> tuple[Tensor, Tensor]:
        """The first winning move of each episode, or a random legal one."""
        return winning_else(self.reach, episodes, super().choose(episodes, number))


class Lookahead(Policy):
    """The legal move after which the corridors' cost of the target is least; of equal ones the first.

    The cost is `now` of `dore.learn.corridor_features`: an estimate of the moves that are left.

    Args:
        max_moves: gives up after this many moves; it expands one board a move.
    """

    name = "lookahead"
    group = 64  # Boards after every legal move are held at once.

    def __init__(self, reach: Reach, max_moves: int) -> None:
        super().__init__(reach, max_moves, max_moves, 1e7)

    def choose(self, episodes: Episodes, number: int) -> tuple[Tensor, Tensor]:
        """The least costly move of each episode."""
        row, cell, lifted, places = legal_pairs(self.reach, episodes)
        pair, to = places.nonzero(as_tuple=True)
        at = row[pair]
        board, target = lifted[pair] | bit(to, lifted.shape[-1]), episodes.target[at]
        cost = corridor_costs(self.reach, board, target).now.masked_fill(retrievable(self.reach, board, target), -1)
        least = torch.full((len(episodes.target),), torch.iinfo(torch.int64).max, device=at.device)
        least = least.scatter_reduce(0, at, cost * len(pair) + torch.arange(len(pair), device=at.device), "amin")
        best = least % max(1, len(pair))
        return cell[pair[best]], to[best]
