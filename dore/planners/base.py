"""What a planner is, and the one way from a planner's moves to a `Plan`: through the independent replay."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import torch
from torch import Tensor

from dore.board import bit, unpack
from dore.instances import InstanceSet
from dore.plan import Move, Plan, PlanError, Status, cell_id, replay
from dore.reach import Reach
from dore.sampling import Batch


class Planner(Protocol):
    """Plans rearrangements. Constructors take `reach: Reach` first, then keys of their own."""

    @property
    def name(self) -> str:
        """What plans, rows and tables call it."""

    def plan(self, batch: Batch) -> list[Plan]:
        """One plan an instance, each of them replayed; no moves where the target is accessible already.

        Args:
            batch: boards Int64[B, W] and targets Int64[B].

        Raises:
            PlanError: a plan does not replay, which is a fault of the planner.
        """


class Draft(NamedTuple):
    """What a planner found for one instance, before anything is checked."""

    moves: Sequence[tuple[int, int]]
    """(pick, place) cells, counted from 0."""
    status: Status
    planning_s: float
    """Wall seconds; where a batch was planned together, its even share."""
    expansions: int = 0
    """Boards whose successors the planner looked at."""
    optimal_moves: int | None = None
    """The proved fewest moves, where known."""
    reason: str = ""
    """Why there is no solution."""


def checked_plans(reach: Reach, start: Batch, drafts: Sequence[Draft], planner: str) -> list[Plan]:
    """Give each move its approach directions and replay each plan.

    A direction is the free sector nearest 0 degrees: for a pick with the obstacle itself off the board and the
    target standing, for a place after the lift, for the target with every obstacle standing.

    Args:
        start: boards Int64[B, W] and targets Int64[B]; drafts: one an instance.
        planner: the planner's name.

    Raises:
        PlanError: a draft breaks a rule; names the instance, the move and why.
    """
    directions, final = _move_directions(reach, start, drafts)
    solved = torch.tensor([draft.status is Status.SOLVED for draft in drafts], dtype=torch.bool)
    rows = solved.nonzero().squeeze(-1)
    target = start.target[rows]
    retrieve = dict(zip(rows.tolist(), _directions(reach, final[rows], target, rows, "target"), strict=True))
    plans = []
    for row, draft in enumerate(drafts):
        moves = tuple(
            Move(pick, place, *degrees)
            for (pick, place), degrees in zip(draft.moves, directions[row], strict=True)
        )
        plan = Plan(
            draft.status,
            moves,
            retrieve.get(row),
            planner,
            draft.planning_s,
            draft.expansions,
            draft.optimal_moves,
            draft.reason,
        )
        scene = next(iter(InstanceSet.scenes(reach, Batch(start.board[row, None], start.target[row, None]))))
        try:
            replay(scene, reach, plan)
        except PlanError as error:
            raise PlanError(f"{planner}, instance {row + 1}: {error}") from None
        plans.append(plan)
    return plans
