"""What a planner is, the one way from its moves to a replayed `Plan`, and labels for instances."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple, Protocol

import torch
from torch import Tensor

from dore.errors import whole
from dore.world.board import bit, unpack
from dore.world.instances import InstanceSet, problems_of
from dore.world.plan import Move, Plan, PlanError, Status, replay
from dore.world.problem import Batch, cell_id
from dore.world.reach import Reach
from dore.world.rules import lift


class Planner(Protocol):
    """Plans rearrangements. Constructors take `reach: Reach` first, then keys of their own."""

    name: str
    """What plans, rows and tables call it."""

    def plan(self, batch: Batch) -> list[Plan]:
        """One plan an instance, each of them replayed; no moves where the target is accessible already.

        Args:
            batch: boards Int64[B, W] and targets Int64[B].

        Raises:
            PlanError: a plan does not replay, which is a fault of the planner.
        """


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


def parts_of(batch: Batch, size: int) -> Iterator[Batch]:
    """The instances of a batch, `size` at a time."""
    for first in range(0, len(batch.target), size):
        yield Batch(batch.board[first : first + size], batch.target[first : first + size])


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
        plan = Plan(
            raw_plan.status,
            moves,
            retrieve[row],
            planner,
            raw_plan.planning_s,
            raw_plan.expansions,
            raw_plan.optimal_moves,
            raw_plan.reason,
        )
        try:
            replay(problem, plan)
        except PlanError as error:
            raise PlanError(f"{planner}, instance {row + 1}: {error}") from None
        plans.append(plan)
    return plans


def _directions(
    reach: Reach, start: Batch, raw_plans: Sequence[RawPlan]
) -> tuple[list[list[tuple[float, float]]], list[float | None]]:
    """Each move's (pick, place) directions and the target's, degrees; step by step, all rows at once."""
    board, words = start.board.clone(), start.board.shape[-1]
    target = bit(start.target, words)
    directions: list[list[tuple[float, float]]] = [[] for _ in raw_plans]
    for step in range(max((len(raw_plan.moves) for raw_plan in raw_plans), default=0)):
        rows = [row for row, raw_plan in enumerate(raw_plans) if len(raw_plan.moves) > step]
        moves = torch.tensor([raw_plans[row].moves[step] for row in rows], device=board.device)
        where = [
            f"instance {row + 1}: move {step + 1} ({cell_id(pick)} to {cell_id(place)})"
            for row, (pick, place) in zip(rows, moves.tolist(), strict=True)
        ]
        pick, place = moves.unbind(-1)
        lifted = lift(board[rows], pick)
        picks = _nearest_free(reach, lifted | target[rows], pick, [f"{move}: pick" for move in where])
        places = _nearest_free(reach, lifted | target[rows], place, [f"{move}: place" for move in where])
        for row, degrees in zip(rows, zip(picks, places, strict=True), strict=True):
            directions[row].append(degrees)
        board[rows] = lifted | bit(place, words)
    solved = [row for row, raw_plan in enumerate(raw_plans) if raw_plan.status is Status.SOLVED]
    where = [f"instance {row + 1}: target" for row in solved]
    found = dict(zip(solved, _nearest_free(reach, board[solved], start.target[solved], where), strict=True))
    return directions, [found.get(row) for row in range(len(raw_plans))]


def _nearest_free(reach: Reach, standing: Tensor, cell: Tensor, where: list[str]) -> list[float]:
    """The approach directions, degrees, of Int64[B] cells on Int64[B, W] boards.

    Raises:
        PlanError: a cell off the board, or one without a free direction.
    """
    for one, name in zip(cell.tolist(), where, strict=True):
        if not 0 <= one < reach.n_cells:
            raise PlanError(f"{name} id {cell_id(one)}, want 1 to {reach.n_cells}")
    blocked = ~reach.cell_accessible(standing, cell)
    if bool(blocked.any()):
        row = int(blocked.nonzero()[0, 0])
        raise PlanError(f"{where[row]}: no free approach direction to cell {cell_id(int(cell[row]))}")
    return reach.direction_deg(unpack(standing, reach.n_cells), cell).tolist()


class Labels(NamedTuple):
    """One entry an instance."""

    status: list[Status]
    optimal_moves: list[int | None]
    """The proved fewest moves; None where no plan, or no proof, is known."""


def label(instances: InstanceSet, planner: Planner, batch_size: int = 1024) -> Labels:
    """Label a set with a planner that proves its plans, such as `Exact`.

    Args:
        batch_size: instances handed to the planner together.

    Raises:
        InputError: a batch size below 1.
        PlanError: a plan does not replay, which is a fault of the planner.
    """
    step = whole("batch_size", batch_size, 1)
    plans = [
        plan
        for first in range(0, len(instances), step)
        for plan in planner.plan(instances.batch(slice(first, first + step)))
    ]
    return Labels([plan.status for plan in plans], [plan.optimal_moves for plan in plans])
