"""Plans, and the independent replay that every plan must pass before it leaves the program.

The replay shares no table and no kernel with the planners: it checks each approach corridor from the definition,
one object at a time, with the geometry of the scene's own layout.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from dore.errors import InputError, integer, number, shown, whole
from dore.world.histogram import EDGE_RAD
from dore.world.problem import Problem, Scene, cell_id
from dore.world.reach import Reach


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
class Move:
    """One pick-and-place. Directions are degrees about cell-to-base, counter-clockwise."""

    pick: int
    place: int
    pick_direction_deg: float
    place_direction_deg: float

    def __post_init__(self) -> None:
        for name in ("pick", "place"):
            cell = integer(getattr(self, name))
            if cell is None:
                raise InputError(f"plan.moves.{name}: got {shown(getattr(self, name))}, want a whole number")
            object.__setattr__(self, name, cell)
        for name in ("pick_direction_deg", "place_direction_deg"):
            object.__setattr__(self, name, float(getattr(self, name)))


@dataclass(frozen=True)
class Plan:
    """Moves that make the target accessible, and the direction to retrieve it from.

    target_direction_deg: None unless the status is solved.
    planning_s: wall seconds spent on this instance (of a batch's, as the planner attributes it).
    expansions: boards whose successors the planner generated.
    optimal_moves: the proved fewest moves, where known.
    reason: why there is no solution, or what a solution took, in a few words; often empty.
    lower_bound: where the planner gave up, the moves that a plan has at least, if it proved that.
    """

    status: Status
    moves: tuple[Move, ...]
    target_direction_deg: float | None
    planner: str
    planning_s: float
    expansions: int = 0
    optimal_moves: int | None = None
    reason: str = ""
    lower_bound: int | None = None

    def __post_init__(self) -> None:
        self._check_types()
        if (self.status is Status.SOLVED) != (self.target_direction_deg is not None):
            raise InputError(f"plan: status {self.status} and target direction {self.target_direction_deg}")
        if self.status is Status.UNSOLVABLE and (self.moves or self.optimal_moves is not None):
            raise InputError(f"plan: status {self.status} with {len(self.moves)} moves, want none, and no optimum")
        if self.status is Status.SOLVED and (self.optimal_moves or 0) > len(self.moves):
            raise InputError(
                f"plan.optimal_moves: got {self.optimal_moves}, and the plan has {len(self.moves)} moves, want no fewer"
            )

        if self.status is not Status.GAVE_UP and self.lower_bound is not None:
            raise InputError(f"plan.lower_bound: got {self.lower_bound} with status {self.status}, want none")

    def _check_types(self) -> None:
        """Refuse what no plan file could hold; numbers of NumPy and torch become Python's."""
        if not isinstance(self.status, Status):
            raise InputError(f"plan.status: got {shown(self.status)}, want a Status")
        if not isinstance(self.moves, tuple) or not all(isinstance(move, Move) for move in self.moves):
            raise InputError(f"plan.moves: got {shown(self.moves)}, want a tuple of Move")
        for name in ("planner", "reason"):
            if not isinstance(getattr(self, name), str):
                raise InputError(f"plan.{name}: got {shown(getattr(self, name))}, want text")
        numbers = {
            "planning_s": number("plan.planning_s", self.planning_s, above=-1e-12),
            "expansions": whole("plan.expansions", self.expansions, 0),
        }
        for name in ("optimal_moves", "lower_bound"):
            if (value := getattr(self, name)) is not None:
                numbers[name] = whole(f"plan.{name}", value, 0)
        for name, value in numbers.items():
            object.__setattr__(self, name, value)


@dataclass(frozen=True)
class PlanFile:
    """What is needed to replay and execute a plan anywhere."""

    problem: Problem
    plan: Plan

    @property
    def scene(self) -> Scene:
        """Where the objects stand before the first move."""
        return self.problem.scene

    @property
    def reach(self) -> Reach:
        """What the plan was made for."""
        return self.problem.reach


def replay(problem: Problem, plan: Plan) -> list[set[int]]:
    """Check every move of a plan against the rules, from the geometry alone.

    Returns:
        The obstacles' cells before the first move and after each one.

    Raises:
        PlanError: naming the first move that breaks a rule, and why.
    """
    scene = problem.scene
    standing = set(scene.obstacles)
    boards = [set(standing)]
    for count, move in enumerate(plan.moves, 1):
        where = f"move {count} ({cell_id(move.pick)} to {cell_id(move.place)})"
        if move.pick not in standing:
            raise PlanError(f"{where}: no obstacle on cell {cell_id(move.pick)}")
        others = (standing - {move.pick}) | {scene.target}
        _check_corridor(problem, move.pick, move.pick_direction_deg, others, f"{where}: pick")
        if move.place in others:
            raise PlanError(f"{where}: cell {cell_id(move.place)} is not empty")
        if not 0 <= move.place < scene.layout.n_cells:
            raise PlanError(f"{where}: place id {cell_id(move.place)}, want 1 to {scene.layout.n_cells}")
        _check_corridor(problem, move.place, move.place_direction_deg, others, f"{where}: place")
        standing = (standing - {move.pick}) | {move.place}
        if standing in boards:
            raise PlanError(f"{where}: goes back to an earlier board")
        boards.append(set(standing))
    if plan.target_direction_deg is not None:
        _check_corridor(problem, scene.target, plan.target_direction_deg, standing, "target")
    return boards


def _check_corridor(problem: Problem, cell: int, direction_deg: float, others: set[int], where: str) -> None:
    """Refuse a direction outside the fan, a corridor that the arm cannot follow, or one that an object blocks."""
    layout, reach = problem.scene.layout, problem.reach
    cells, r = layout.cells, reach.clearance_m
    x, y = cells[cell]
    if math.isnan(direction_deg):
        raise PlanError(f"{where}: no free approach direction to cell {cell_id(cell)}")
    if not abs(direction_deg) <= reach.half_fan_deg + 1e-6:
        raise PlanError(f"{where} direction {direction_deg:g} deg, want within +-{reach.half_fan_deg:g}")
    yaw = math.atan2(y, x) + math.radians(direction_deg)
    if reach.max_yaw_deg is not None and abs(yaw) > math.radians(reach.max_yaw_deg) + 1e-6:
        raise PlanError(f"{where} corridor heads {math.degrees(yaw):.1f} deg, want within +-{reach.max_yaw_deg:g}")
    if reach.lateral_limit_m is not None:
        crossing = y - (x - layout.front_m + reach.staging_m) * math.tan(yaw)
        if math.cos(yaw) <= 0 or abs(crossing) > reach.lateral_limit_m + 1e-6:
            raise PlanError(
                f"{where} corridor crosses the staging line at y = {crossing:.3f} m, "
                f"want within +-{reach.lateral_limit_m:g}"
            )
    approach = math.atan2(-y, -x) + math.radians(direction_deg)
    for other in sorted(others):
        dx, dy = cells[other][0] - x, cells[other][1] - y
        distance = math.hypot(dx, dy)
        half_width = math.asin(r / distance) if r < distance else math.pi / 2
        off = abs(math.remainder(math.atan2(dy, dx) - approach, math.tau))
        # Sectors this near an edge count as covered for the planners, so the replay may be that much more lenient.
        if off <= half_width - 2 * EDGE_RAD:
            raise PlanError(
                f"{where} corridor at {direction_deg:g} deg is blocked by the object on cell {cell_id(other)}"
            )
