"""Leaves out of a plan what a replay shows to be needless. B denotes the batch, W the words of a board."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence

import numpy as np

from dore.planners.base import RawPlan
from dore.world.kernels.tables import unsigned
from dore.world.plan import Status
from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.replayed import Moves, replayed

Pairs = list[tuple[int, int]]
"""(pick, place) cells in turn."""


def shortened(reach: Reach, batch: Batch, plans: Sequence[RawPlan]) -> list[RawPlan]:
    """The plans of B instances, those that are solved with as few of their moves as still solve them.

    A move is dropped, or an obstacle that is moved twice is moved once, whenever the plan still replays and the target
    is accessible in the end; until nothing more can be left out. Nothing is searched for: a plan of other moves may be
    shorter. The time that this takes is added to that of each plan. Not in the paper.
    """
    boards, targets = unsigned(batch.board), batch.target.cpu().numpy()
    found = list(plans)
    for row, plan in enumerate(plans):
        if plan.status is Status.SOLVED:
            began = time.perf_counter()
            moves = _shortest(reach, boards[row : row + 1], targets[row : row + 1], list(plan.moves))
            found[row] = plan._replace(moves=moves, planning_s=plan.planning_s + time.perf_counter() - began)
    return found


def _shortest(reach: Reach, board: np.ndarray, target: np.ndarray, moves: Pairs) -> Pairs:
    """The moves from uint64[1, W] to an accessible int64[1] target, shortened again and again."""
    while (shorter := next((one for one in _shorter(moves) if _solves(reach, board, target, one)), None)) is not None:
        moves = shorter
    return moves


def _shorter(moves: Pairs) -> Iterator[Pairs]:
    """Every plan of one move fewer, or two, from the last move to the first."""
    for at in reversed(range(len(moves))):
        before, (pick, place), after = moves[:at], moves[at], moves[at + 1 :]
        yield before + after
        again = next((index for index, (cell, _) in enumerate(after) if cell == place), None)
        if again is None:
            continue
        between, to, rest = after[:again], after[again][1], after[again + 1 :]
        if to == pick:
            yield before + between + rest
        else:
            yield [*before, (pick, to), *between, *rest]
            yield [*before, *between, (pick, to), *rest]


def _solves(reach: Reach, board: np.ndarray, target: np.ndarray, moves: Pairs) -> bool:
    """Whether the moves replay, and the target is accessible after them."""
    cells = np.array([*moves, (0, 0)], np.int32).reshape(1, -1)  # At least as wide as the replay wants.
    return replayed(reach, board, target, Moves(cells, np.array([len(moves)]), np.array([True]))).n_right == 1
