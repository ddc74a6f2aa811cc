"""Greedy episodes of a policy on a batch of instances; those that have ended leave the batch.

B denotes the batch, T the step limit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from dore.world.board import bit
from dore.world.episode import Episodes, advance, begin, resumed
from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.rules import Failure, lift

Choose = Callable[[Episodes], tuple[Tensor, Tensor]]
"""B episodes -> the cells Int64[B] to pick from and to place on."""


@dataclass(frozen=True)
class Rollout:
    """How the episodes went.

    pick, place: Int64[B, T] cells, meaningful for the first `n_moves` of a row.
    n_moves: Int64[B], accepted moves that were not taken back.
    tried: Int64[B], choices made.
    solved: Bool[B].
    failure: Int64[B], a `Failure` code; NONE where solved or where the step limit came first.
    """

    pick: Tensor
    place: Tensor
    n_moves: Tensor
    tried: Tensor
    solved: Tensor
    failure: Tensor

    def moves(self, row: int) -> list[tuple[int, int]]:
        """The moves of a row, those that were taken back left out."""
        n = int(self.n_moves[row])
        return list(zip(self.pick[row, :n].tolist(), self.place[row, :n].tolist(), strict=True))


@torch.no_grad()
def greedy_rollout(choose: Choose, reach: Reach, batch: Batch, max_moves: int, backtrack: bool = False) -> Rollout:
    """Play every instance greedily until it is solved, fails, or has made `max_moves` moves.

    backtrack: where no legal move is left, take the last move back and choose again; no board is visited twice. Moves
    that are taken back count towards `max_moves`, but not in `n_moves`: what is left is one way from the start.
    """
    n, device = len(batch.target), batch.target.device
    pick = torch.zeros(n, max_moves, dtype=torch.int64, device=device)
    place = torch.zeros_like(pick)
    n_moves, tried = (torch.zeros(n, dtype=torch.int64, device=device) for _ in range(2))
    rows, episodes = torch.arange(n, device=device), begin(reach, batch, max_moves)
    solved, failure = episodes.solved.clone(), episodes.failure.clone()
    for _ in range(max_moves):
        going = (~episodes.solved & (episodes.failure == Failure.NONE)).nonzero().squeeze(-1)
        if not len(going):
            break
        rows, episodes = rows[going], episodes.at(going)
        chosen = choose(episodes)
        pick[rows, n_moves[rows]], place[rows, n_moves[rows]] = chosen
        episodes, _ = advance(reach, episodes, *chosen)
        solved[rows], failure[rows] = episodes.solved, episodes.failure
        n_moves[rows] += episodes.accepted.long()
        tried[rows] += 1
        if backtrack:
            episodes = _taken_back(reach, episodes, rows, pick, place, n_moves)
            failure[rows] = episodes.failure
    return Rollout(pick, place, n_moves, tried, solved, failure)


def _taken_back(
    reach: Reach, episodes: Episodes, rows: Tensor, pick: Tensor, place: Tensor, n_moves: Tensor
) -> Episodes:
    """The episodes, those without a legal move where they last had one; `n_moves` falls by as many moves."""
    while len(stuck := ((episodes.failure == Failure.NO_LEGAL_MOVE) & (n_moves[rows] > 0)).nonzero().squeeze(-1)):
        row = rows[stuck]
        n_moves[row] -= 1
        last = n_moves[row]
        now = episodes.at(stuck)
        board = lift(now.board, place[row, last]) | bit(pick[row, last], reach.n_words)
        episodes = episodes.put(stuck, resumed(reach, board, now.target, now.visited, now.steps))
    return episodes
