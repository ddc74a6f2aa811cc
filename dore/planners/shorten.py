"""Leaves out of a plan what a replay shows to be needless. B denotes the batch."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from dore.planners.base import RawPlan
from dore.world.kernels.shorten import shorten
from dore.world.kernels.tables import unsigned
from dore.world.plan import Status
from dore.world.problem import Batch
from dore.world.reach import Reach

MAX_REPLAYS = 200_000
"""Of a plan, with obstacles on other cells: some 40 ms. Long plans with two of them would take seconds."""


def shortened(reach: Reach, batch: Batch, plans: Sequence[RawPlan]) -> list[RawPlan]:
    """The plans of B instances, those that are solved with fewer moves wherever one of these changes allows it:

    1. a move is left out; of an obstacle that is moved twice, both moves, or one of them, which then puts it where the
       second one did;
    2. the same, and one or two other obstacles are put on other cells than before.

    A change is made whenever the plan still replays and the target is accessible in the end, the second kind where
    none of the first is left; until none of either is, or `MAX_REPLAYS` are made. No tree of boards is searched, and
    a shorter plan of other picks may exist. The time that this takes is added to that of each plan. Not in the paper.
    """
    boards, targets = unsigned(batch.board), batch.target.tolist()
    found = list(plans)
    for row, plan in enumerate(plans):
        if plan.status is Status.SOLVED and plan.moves:
            began = time.perf_counter()
            moves = _shortest(reach, boards[row], targets[row], plan.moves)
            found[row] = plan._replace(moves=moves, planning_s=plan.planning_s + time.perf_counter() - began)
    return found


def _shortest(reach: Reach, board: np.ndarray, target: int, moves: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """The moves from uint64[W] to an accessible target, shortened again and again."""
    n = len(moves)
    cells, fewer = np.array(moves, np.int32).ravel(), np.empty(2 * n, np.int32)
    room, sectors = np.empty((n + 1, len(board)), np.uint64), np.empty(2 * n + 1, np.int16)
    replays = np.array([MAX_REPLAYS])
    left = shorten(tuple(reach.histogram), board, target, cells, n, fewer, room, sectors, replays)
    return [(pick, place) for pick, place in cells[: 2 * left].reshape(-1, 2).tolist()]
