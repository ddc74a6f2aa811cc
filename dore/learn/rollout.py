"""Greedy episodes of a policy on a batch of instances; finished rows leave the batch.

B denotes the batch, T the step limit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.rules import Failure, legal_moves, transition

Choose = Callable[[Tensor, Tensor, Tensor, Tensor], tuple[Tensor, Tensor]]
"""Boards Int64[B, W], targets Int64[B], the episodes' boards Int64[B, T, W] and legal picks Bool[B, G] -> the cells
Int64[B] to pick from and to place on."""


@dataclass(frozen=True)
class Rollout:
    """How the episodes went.

    pick, place: Int64[B, T] cells, meaningful for the first `n_moves` of a row.
    n_moves: Int64[B], accepted moves.
    solved: Bool[B].
    failure: Int64[B], a `Failure` code; NONE where solved or where the step limit came first.
    """

    pick: Tensor
    place: Tensor
    n_moves: Tensor
    solved: Tensor
    failure: Tensor

    def moves(self, row: int) -> list[tuple[int, int]]:
        """The accepted moves of a row."""
        n = int(self.n_moves[row])
        return list(zip(self.pick[row, :n].tolist(), self.place[row, :n].tolist(), strict=True))


@torch.no_grad()
def greedy_rollout(choose: Choose, reach: Reach, batch: Batch, max_moves: int) -> Rollout:
    """Play every instance greedily until it is solved, fails, or has made `max_moves` moves."""
    n, device = len(batch.target), batch.target.device
    pick = torch.zeros(n, max_moves, dtype=torch.int64, device=device)
    place = torch.zeros_like(pick)
    n_moves = torch.zeros(n, dtype=torch.int64, device=device)
    failure = torch.zeros_like(n_moves)
    rows, (board, target) = torch.arange(n, device=device), batch
    visited = board[:, None].repeat(1, max_moves + 1, 1)
    legal = legal_moves(reach, board, target, visited)
    solved = legal.solved.clone()
    for step in range(max_moves):
        stuck = ~legal.solved & ~legal.pick.any(-1)
        failure[rows[stuck]] = int(Failure.NO_LEGAL_MOVE)
        going = (~legal.solved & ~stuck).nonzero().squeeze(-1)
        if not len(going):
            break
        rows, board, target, visited = rows[going], board[going], target[going], visited[going]
        chosen = choose(board, target, visited, legal.pick[going])
        outcome = transition(reach, board, target, visited, *chosen)
        pick[rows, step], place[rows, step] = chosen
        accepted = outcome.failure == Failure.NONE
        failure[rows] = outcome.failure
        n_moves[rows] += accepted.long()
        kept = accepted.nonzero().squeeze(-1)
        rows, board, target, visited = rows[kept], outcome.board[kept], target[kept], visited[kept]
        visited = visited.index_copy(1, torch.tensor([step + 1], device=device), board[:, None])
        legal = legal_moves(reach, board, target, visited)
        solved[rows] = legal.solved
    return Rollout(pick, place, n_moves, solved, failure)
