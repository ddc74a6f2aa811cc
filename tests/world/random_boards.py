"""Random boards with random histories, and what every move on them would do."""

from __future__ import annotations

import torch
from torch import Tensor

from dore.world.board import pack
from dore.world.reach import Reach
from dore.world.rules import (
    transition,
)
from tests.drawings import wide_hand

REACH = wide_hand(3, 4)

G = REACH.n_cells


def random_boards(n: int, seed: int, reach: Reach = REACH, dense: bool = False) -> tuple[Tensor, Tensor]:
    """Boards Int64[n, W] of every density (dense: at least 60 %) without their targets Int64[n]."""
    generator = torch.Generator().manual_seed(seed)
    share = torch.rand(n, 1, generator=generator)
    occupied = torch.rand(n, reach.n_cells, generator=generator) < (0.6 + 0.4 * share if dense else share)
    target = torch.randint(reach.n_cells, (n,), generator=generator)
    occupied[torch.arange(n), target] = False
    return pack(occupied), target


def history(reach: Reach, board: Tensor, target: Tensor, steps: int, seed: int) -> tuple[Tensor, Tensor]:
    """The board after some random accepted moves, and all boards so far: Int64[B, W], Int64[B, T, W]."""
    generator = torch.Generator().manual_seed(seed)
    visited = board[:, None]
    for _ in range(steps):
        pick = torch.randint(reach.n_cells, target.shape, generator=generator)
        for _ in range(20):
            place = torch.randint(reach.n_cells, target.shape, generator=generator)
            again = torch.randint(reach.n_cells, target.shape, generator=generator)
            outcome = transition(reach, board, target, visited, pick, place)
            pick = torch.where(outcome.failure == 0, pick, again)
            board = torch.where((outcome.failure == 0)[:, None], outcome.board, board)
            visited = torch.cat([visited, board[:, None]], 1)
    return board, visited


def all_pairs(reach: Reach, board: Tensor, target: Tensor, visited: Tensor) -> Tensor:
    """Int64[B, G, G]: the failure of every (pick, place)."""
    g, n = reach.n_cells, len(target)
    pick = torch.arange(g).repeat_interleave(g).repeat(n)
    place = torch.arange(g).repeat(g * n)
    row = torch.arange(n).repeat_interleave(g * g)
    return transition(reach, board[row], target[row], visited[row], pick, place).failure.view(n, g, g)
