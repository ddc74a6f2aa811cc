"""Episodes under way: the one definition of what a move leads to, and of what ends an episode.

The TorchRL environment and the greedy rollouts both play by it. B denotes the batch, G the cells, W the words of a
board, T the boards an episode remembers.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.rules import Failure, LegalMoves, legal_moves, transition

MAX_MOVES = 1_000
"""No episode is longer: each remembers all of its boards."""


class Episodes(NamedTuple):
    """B episodes, each at a board of its own."""

    board: Tensor
    """Int64[B, W]: the obstacles."""
    target: Tensor
    """Int64[B]: the target's cell."""
    visited: Tensor
    """Int64[B, T, W]: the boards so far, the present one included; unused places repeat the first."""
    steps: Tensor
    """Int64[B]: moves tried."""
    failure: Tensor
    """Int64[B]: a `Failure` code: of the last move, or NO_LEGAL_MOVE."""
    legal: LegalMoves
    """What may be done next, and whether the target is accessible."""

    @property
    def solved(self) -> Tensor:
        """Bool[B]: the target is accessible, and the last move was accepted."""
        return self.legal.solved & (self.failure == Failure.NONE)

    @property
    def accepted(self) -> Tensor:
        """Bool[B]: the last move was carried out."""
        return (self.failure == Failure.NONE) | (self.failure == Failure.NO_LEGAL_MOVE)

    def at(self, rows: Tensor) -> Episodes:
        """Those rows, by Int64 indices."""
        legal = LegalMoves(*(mask[rows] for mask in self.legal))
        board, target, visited, steps, failure = (field[rows] for field in self[:5])
        return Episodes(board, target, visited, steps, failure, legal)

    def put(self, rows: Tensor, others: Episodes) -> Episodes:
        """A copy in which Int64 `rows` are those other episodes, one a row."""
        merged = [old.index_copy(0, rows, new) for old, new in zip(self[:5], others[:5], strict=True)]
        legal = [old.index_copy(0, rows, new) for old, new in zip(self.legal, others.legal, strict=True)]
        board, target, visited, steps, failure = merged
        return Episodes(board, target, visited, steps, failure, LegalMoves(*legal))


def begin(reach: Reach, start: Batch, max_moves: int) -> Episodes:
    """Episodes at their start boards Int64[B, W] and targets Int64[B], with memory for `max_moves` moves."""
    board, target = start
    visited = board[:, None].repeat(1, max_moves + 1, 1)
    return resumed(reach, board, target, visited, torch.zeros_like(target))


def advance(reach: Reach, episodes: Episodes, pick: Tensor, place: Tensor) -> tuple[Episodes, Tensor]:
    """One pick-and-place in every row; a row's result depends on that row only.

    A refused move changes nothing on the board. A row that is advanced past its memory overwrites its last place.

    Args:
        pick, place: Int64[B] cells; illegal ones fail.

    Returns:
        The episodes after it, and Bool[B]: the lift alone made the target accessible (the pick network's reward).
    """
    board, target, visited, steps, _, legal = episodes
    outcome = transition(reach, board, target, visited, pick, place, legal.pickable)
    steps = steps + 1
    slot = steps.clamp_max(visited.shape[1] - 1)[:, None, None].expand(-1, 1, board.shape[-1])
    accepted = (outcome.failure == Failure.NONE)[:, None, None]
    visited = visited.scatter(1, slot, torch.where(accepted, outcome.board[:, None], visited[:, :1]))
    return resumed(reach, outcome.board, target, visited, steps, outcome.failure), outcome.opened


def resumed(
    reach: Reach, board: Tensor, target: Tensor, visited: Tensor, steps: Tensor, failure: Tensor | None = None
) -> Episodes:
    """Episodes that are on these boards already; see `Episodes` for the shapes.

    failure: of the last move, Int64[B]; None where it was accepted. Where no move is left it becomes NO_LEGAL_MOVE.
    """
    legal = legal_moves(reach, board, target, visited)
    failure = torch.zeros_like(target) if failure is None else failure
    stuck = (failure == Failure.NONE) & ~legal.solved & ~legal.pick.any(-1)
    return Episodes(board, target, visited, steps, failure.masked_fill(stuck, int(Failure.NO_LEGAL_MOVE)), legal)
