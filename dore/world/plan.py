"""Scenes, plans, and the independent replay that every plan must pass before it leaves the program.

The replay shares no table and no kernel with the planners: it works out each lane from the definition, one
object at a time. In code cells count from 0; `cell_id` is what people read.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from dore.errors import InputError
from dore.world.layout import Layout
from dore.world.reach import EDGE_RAD, Reach


class Status(StrEnum):
    """How a planner's search ended."""

    SOLVED = "solved"
    UNSOLVABLE = "unsolvable"
    """Proved: every board that can be reached has been seen."""
    GAVE_UP = "gave_up"
    """The budget is spent; nothing is proved."""


class PlanError(InputError):
    """A plan that does not replay: names the move and why."""


@dataclass(frozen=True)
class Scene:
    """A problem: where the obstacles and the target stand. Cells count from 0.

    Raises:
        InputError: a cell off the board, two objects on a cell, or the target among the obstacles.
    """

    layout: Layout
    obstacles: tuple[int, ...]
    target: int

    def __post_init__(self) -> None:
        for name, cell in [("obstacles", cell) for cell in self.obstacles] + [("target", self.target)]:
            if not 0 <= cell < self.layout.n_cells:
                raise InputError(f"scene.{name}: id {cell_id(cell)}, want 1 to {self.layout.n_cells}")
        for cell in self.obstacles:
            if self.obstacles.count(cell) > 1:
                raise InputError(f"scene.obstacles: two objects on cell {cell_id(cell)}, want one at most")
        if self.target in self.obstacles:
            raise InputError(f"scene.target: cell {cell_id(self.target)} holds an obstacle, want the target alone")


@dataclass(frozen=True)
class Move:
    """One pick-and-place. Directions are degrees about cell-to-base, counter-clockwise."""

    pick: int
    place: int
    pick_direction_deg: float
    place_direction_deg: float


@dataclass(frozen=True)
class Plan:
    """Moves that make the target accessible, and the direction to retrieve it from.

    target_direction_deg: None unless the status is solved.
    planning_s: wall seconds spent on this instance (a batch's time is shared out evenly).
    expansions: boards whose successors the planner looked at.
    optimal_moves: the proved fewest moves, where known.
    reason: why there is no solution, or what a solution took, in a few words; often empty.
    """

    status: Status
    moves: tuple[Move, ...]
    target_direction_deg: float | None
    planner: str
    planning_s: float
    expansions: int = 0
    optimal_moves: int | None = None
    reason: str = ""

    def __post_init__(self) -> None:
        if (self.status is Status.SOLVED) != (self.target_direction_deg is not None):
            raise InputError(f"plan: status {self.status} and target direction {self.target_direction_deg}")


@dataclass(frozen=True)
class PlanFile:
    """What is needed to replay and execute a plan anywhere."""

    scene: Scene
    reach: Reach
    plan: Plan


def cell_id(cell: int) -> int:
    """The paper's id of a cell: 1..G."""
    return cell + 1


def replay(scene: Scene, reach: Reach, plan: Plan) -> list[set[int]]:
    """Check every move of a plan against the rules, from the geometry alone.

    Returns:
        The obstacles' cells before the first move and after each one.

    Raises:
        PlanError: naming the first move that breaks a rule, and why.
    """
    standing = set(scene.obstacles)
    boards = [set(standing)]
    for number, move in enumerate(plan.moves, 1):
        where = f"move {number} ({cell_id(move.pick)} to {cell_id(move.place)})"
        if move.pick not in standing:
            raise PlanError(f"{where}: no obstacle on cell {cell_id(move.pick)}")
        others = (standing - {move.pick}) | {scene.target}
        _check_lane(reach, move.pick, move.pick_direction_deg, others, f"{where}: pick")
        if move.place in others:
            raise PlanError(f"{where}: cell {cell_id(move.place)} is not empty")
        if not 0 <= move.place < scene.layout.n_cells:
            raise PlanError(f"{where}: place id {cell_id(move.place)}, want 1 to {scene.layout.n_cells}")
        _check_lane(reach, move.place, move.place_direction_deg, others, f"{where}: place")
        standing = (standing - {move.pick}) | {move.place}
        if standing in boards:
            raise PlanError(f"{where}: goes back to an earlier board")
        boards.append(set(standing))
    if plan.target_direction_deg is not None:
        _check_lane(reach, scene.target, plan.target_direction_deg, standing, "target")
    return boards


def _check_lane(reach: Reach, cell: int, direction_deg: float, others: set[int], where: str) -> None:
    """Refuse a direction outside the fan, a lane that the arm cannot follow, or one that an object covers."""
    cells, r = reach.layout.cells, reach.clearance_m
    x, y = cells[cell]
    if not abs(direction_deg) <= reach.half_fan_deg + 1e-6:
        raise PlanError(f"{where} direction {direction_deg:g} deg, want within +-{reach.half_fan_deg:g}")
    yaw = math.atan2(y, x) + math.radians(direction_deg)
    if reach.max_yaw_deg is not None and abs(yaw) > math.radians(reach.max_yaw_deg) + 1e-6:
        raise PlanError(f"{where} lane heads {math.degrees(yaw):.1f} deg, want within +-{reach.max_yaw_deg:g}")
    if reach.lateral_limit_m is not None:
        crossing = y - (x - reach.layout.front_m + reach.staging_m) * math.tan(yaw)
        if math.cos(yaw) <= 0 or abs(crossing) > reach.lateral_limit_m + 1e-6:
            raise PlanError(
                f"{where} lane crosses the staging line at y = {crossing:.3f} m, "
                f"want within +-{reach.lateral_limit_m:g}"
            )
    lane = math.atan2(-y, -x) + math.radians(direction_deg)
    for other in sorted(others):
        dx, dy = cells[other][0] - x, cells[other][1] - y
        distance = math.hypot(dx, dy)
        half_width = math.asin(r / distance) if r < distance else math.pi / 2
        off = abs(math.remainder(math.atan2(dy, dx) - lane, math.tau))
        # Sectors this near an edge count as covered for the planners, so the replay may be that much kinder.
        if off <= half_width - 2 * EDGE_RAD:
            raise PlanError(f"{where} lane at {direction_deg:g} deg is blocked by the object on cell {cell_id(other)}")
