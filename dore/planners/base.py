"""What a planner is, and the one way from its moves to a replayed `Plan`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

import torch

from dore.world.board import bit
from dore.world.instances import problems_of
from dore.world.plan import Move, Plan, PlanError, Status, replay
from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.rules import lift

EXHAUSTED = "all {} boards that can be reached are exhausted"
"""The reason of a plan where a search proves that there is no solution."""
LOCKED = "1 board seen: what blocks the target can never be reached"
"""The same, where the relaxation of the start board proves it."""


class RawPlan(NamedTuple):
    """What a planner found for one instance, before anything is checked."""

    moves: Sequence[tuple[int, int]]
    """(pick, place) cells, counted from 0."""
    status: Status
    planning_s: float
    """Wall seconds; where a batch was planned together, the share that the planner attributes to this instance."""
    expansions: int = 0
    """Boards whose successors the planner generated."""
    optimal_moves: int | None = None
    """The proved fewest moves, where known."""
    reason: str = ""
    """Why there is no solution, in a few words."""
    lower_bound: int | None = None
    """Of an instance that was given up: no plan has fewer moves."""


class Planner(ABC):
    """Plans rearrangements. Constructors take `reach: Reach` first, then keys of their own."""

    name: str
    """What plans, rows and tables call it."""
    reach: Reach
    group: int | None = None
    """The most instances that `raw_plans` gets at once; None: any number."""

    def plan(self, batch: Batch) -> list[Plan]:
        """One plan an instance, each of them replayed; no moves where the target is accessible already.

        Args:
            batch: boards Int64[B, W] and targets Int64[B].

        Raises:
            PlanError: a plan does not replay, which is a fault of the planner.
        """
        n = len(batch.target)
        size = self.group or max(1, n)
        parts = [Batch(*(field[first : first + size] for field in batch)) for first in range(0, n, size)]
        raw_plans = [raw_plan for part in parts for raw_plan in self.raw_plans(part)]
        return checked_plans(self.reach, batch, raw_plans, self.name)

    @abstractmethod
    def raw_plans(self, batch: Batch) -> list[RawPlan]:
        """What is found for each instance of a batch, before anything is checked."""


def checked_plans(reach: Reach, start: Batch, raw_plans: Sequence[RawPlan], planner: str) -> list[Plan]:
    """Give each move its approach directions and replay each plan.

    A direction is the free sector nearest 0 degrees: for a pick with the obstacle itself off the board and the
    target standing, for a place after the lift, for the target with every obstacle standing.

    Args:
        start: boards Int64[B, W] and targets Int64[B]; raw_plans: one an instance.
        planner: the planner's name.

    Raises:
        PlanError: a raw_plan breaks a rule; names the planner, the instance's place in the batch, the move and why.
    """
    directions, retrieve = _directions(reach, start, raw_plans)
    plans = []
    for row, (raw_plan, problem) in enumerate(zip(raw_plans, problems_of(reach, start), strict=True)):
        moves = tuple(Move(*move, *degrees) for move, degrees in zip(raw_plan.moves, directions[row], strict=True))
        # From the seconds on, both have the same fields.
        plan = Plan(raw_plan.status, moves, retrieve[row], planner, *raw_plan[2:])
        try:
            replay(problem, plan)
        except PlanError as error:
            raise PlanError(f"{planner}, instance {row + 1}: {error}") from None
        plans.append(plan)
    return plans


def _directions(
    reach: Reach, start: Batch, raw_plans: Sequence[RawPlan]
) -> tuple[list[list[tuple[float, float]]], list[float | None]]:
    """Each move's (pick, place) directions and the target's, degrees; step by step, all rows at once.

    Where a cell is not accessible the direction is nan, which no replay accepts; None: the plan is no solution.
    """
    board, words = start.board.clone(), start.board.shape[-1]
    target = bit(start.target, words)
    directions: list[list[tuple[float, float]]] = [[] for _ in raw_plans]
    for step in range(max((len(raw_plan.moves) for raw_plan in raw_plans), default=0)):
        rows = [row for row, raw_plan in enumerate(raw_plans) if len(raw_plan.moves) > step]
        moves = torch.tensor([raw_plans[row].moves[step] for row in rows], device=board.device)
        lifted = lift(board[rows], moves[:, 0])
        # The replay names a cell that is off the board.
        pick, place = moves.clamp(0, reach.n_cells - 1).unbind(-1)
        degrees = [reach.direction_deg(lifted | target[rows], cell).tolist() for cell in (pick, place)]
        for row, pair in zip(rows, zip(*degrees, strict=True), strict=True):
            directions[row].append(pair)
        board[rows] = lifted | bit(moves[:, 1], words)
    retrieve = reach.direction_deg(board, start.target).tolist()
    solved = (raw_plan.status is Status.SOLVED for raw_plan in raw_plans)
    return directions, [degrees if one else None for degrees, one in zip(retrieve, solved, strict=True)]
