"""What a planner is, and the one way from its moves to a replayed `Plan`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple, NoReturn

import numpy as np

from dore.world.histogram import unpack
from dore.world.kernels.tables import unsigned
from dore.world.plan import Move, Plan, PlanError, Status, replay
from dore.world.problem import Batch, Problem, Scene
from dore.world.reach import Reach
from dore.world.replayed import Moves, Replayed, replayed

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
    """Where the planner gave up: no plan has fewer moves."""


class Planner(ABC):
    """Plans rearrangements. Constructors take `reach: Reach` first, then keys of their own."""

    name: str
    """Its name in plans, rows and tables."""
    reach: Reach
    group: int | None = None
    """The most instances that `raw_plans` gets at once; None: any number."""

    def plan(self, batch: Batch) -> Sequence[Plan]:
        """One plan an instance, each of them replayed; no moves where the target is accessible already.

        Args:
            batch: boards Int64[B, W] and targets Int64[B].

        Raises:
            PlanError: a plan does not replay, which is a fault of the planner.
        """
        raw_plans = [raw_plan for part in parts_of(batch, self.group) for raw_plan in self.raw_plans(part)]
        return checked_plans(self.reach, batch, raw_plans, self.name)

    def plan_one(self, problem: Problem) -> Plan:
        """As `plan`, of one problem."""
        return self.plan(Batch.of(problem))[0]

    @abstractmethod
    def raw_plans(self, batch: Batch) -> list[RawPlan]:
        """What is found for each instance of a batch, before anything is checked."""


def parts_of(batch: Batch, size: int | None) -> list[Batch]:
    """A batch in parts of so many instances; None: in one."""
    n = len(batch.target)
    size = size or max(1, n)
    return [Batch(*(field[first : first + size] for field in batch)) for first in range(0, n, size)]


def checked_plans(reach: Reach, start: Batch, raw_plans: Sequence[RawPlan], planner: str) -> list[Plan]:
    """Give each move its approach directions, those of `dore.world.replayed`, and replay each plan.

    Args:
        start: boards Int64[B, W] and targets Int64[B]; raw_plans: one an instance.
        planner: the planner's name.

    Raises:
        PlanError: a raw_plan breaks a rule; names the planner, the instance's place in the batch, the move and why.
    """
    n_moves = np.array([len(raw_plan.moves) for raw_plan in raw_plans], np.int64)
    cells = np.zeros((len(raw_plans), 2 * int(n_moves.max(initial=0))), np.int32)
    for row, raw_plan in enumerate(raw_plans):
        if raw_plan.moves:
            # A cell off the board is off the board as 32 bits, too.
            cells[row, : 2 * len(raw_plan.moves)] = np.clip(np.array(raw_plan.moves).ravel(), -1, reach.n_cells)
    solved = np.array([raw_plan.status is Status.SOLVED for raw_plan in raw_plans], np.bool_)
    boards, targets = unsigned(start.board), start.target.cpu().numpy()
    right = replayed(reach, boards, targets, Moves(cells, n_moves, solved))
    plans = [plan_of(raw_plan, right, row, planner) for row, raw_plan in enumerate(raw_plans[: right.n_right + 1])]
    if right.n_right < len(plans):
        refuse(reach, boards[right.n_right], int(targets[right.n_right]), right.n_right, plans[-1])
    return plans


def plan_of(raw_plan: RawPlan, right: Replayed, row: int, planner: str) -> Plan:
    """A raw plan with the directions of its row; where the replay found none, they are nan."""
    directions = right.directions(row, len(raw_plan.moves))
    pairs = zip(raw_plan.moves, directions[::2], directions[1::2], strict=False)
    moves = tuple(Move(*move, pick, place) for move, pick, place in pairs)
    target = directions[-1] if raw_plan.status is Status.SOLVED else None
    # From the seconds on, both have the same fields.
    return Plan(raw_plan.status, moves, target, planner, *raw_plan[2:])


def refuse(reach: Reach, board: np.ndarray, target: int, row: int, plan: Plan) -> NoReturn:
    """Raise the error of the replay from the geometry for the plan of a row; board: uint64[W].

    Raises:
        PlanError: always.
    """
    obstacles = tuple(unpack(board, reach.n_cells).nonzero()[0].tolist())
    problem = Problem(Scene(reach.layout, obstacles, target), reach)
    try:
        replay(problem, plan)
    except PlanError as error:
        raise PlanError(f"{plan.planner}, instance {row + 1}: {error}") from None
    raise PlanError(f"{plan.planner}, instance {row + 1}: the corridors' table refuses what their geometry accepts")
