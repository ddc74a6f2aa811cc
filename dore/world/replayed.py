"""Replays many plans at once, compiled, from the reach's whole histogram, and finds their approach directions.

`dore.world.plan.replay` does the same for one plan from the geometry, with the directions that the plan states.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dore.world.kernels.replay import replay
from dore.world.reach import Reach


class Moves(NamedTuple):
    """The moves of B plans.

    cells: int32[B, 2M or more], (pick, place) in turn. n_moves: int64[B].
    solved: bool[B], whether the target must be accessible after the last one.
    """

    cells: np.ndarray
    n_moves: np.ndarray
    solved: np.ndarray


class Replayed(NamedTuple):
    """What a replay of B plans found.

    n_right: how many plans are right before the first that breaks a rule; B: all of them.
    sectors: int16[B, 2M + 1], as in `dore.world.kernels.replay`. degrees: of each sector; of BLOCKED: nan.
    """

    n_right: int
    sectors: np.ndarray
    degrees: Sequence[float]

    def directions(self, row: int, n_moves: int) -> list[float]:
        """Degrees, for each move of a plan the pick's and the place's, then the target's; nan: none is known."""
        return [self.degrees[sector] for sector in self.sectors[row, : 2 * n_moves + 1].tolist()]


def replayed(reach: Reach, boards: np.ndarray, targets: np.ndarray, moves: Moves) -> Replayed:
    """Replay plans, one each from uint64[B, W] boards with int64[B] targets, up to the first that breaks a rule.

    A direction is the free sector nearest 0 degrees: for a pick with the obstacle itself off the board and the target
    standing, for a place after the lift, for the target with every obstacle standing.
    """
    most = int(moves.n_moves.max()) if len(moves.n_moves) else 0
    room, sectors = np.empty((most + 1, boards.shape[1]), np.uint64), np.empty((len(boards), 2 * most + 1), np.int16)
    n_right = replay(tuple(reach.histogram), boards, targets, *moves, room, sectors)
    return Replayed(n_right, sectors, reach.degrees)
