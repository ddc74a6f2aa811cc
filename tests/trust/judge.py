"""A judge of plans that shares no code with the program: numbers in, a verdict out, in plain Python.

It works with distances from a ray where the program works with angles: an object blocks an approach corridor when its
centre is not behind the cell and no farther than the clearance from the corridor's axis.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

EPSILON = 1e-7
"""Metres; an object this near the edge of a corridor may count as in it or out of it."""
Cell = int
Board = frozenset[Cell]


@dataclass(frozen=True)
class World:
    """Cell centres in metres, and the numbers of a reach as a plan file holds them."""

    cells: tuple[tuple[float, float], ...]
    cell_m: float
    reach: tuple[tuple[str, float], ...]

    @classmethod
    def of(cls, cells: Any, cell_m: float, reach: dict[str, float]) -> World:
        """From lists and dicts."""
        return cls(tuple((float(x), float(y)) for x, y in cells), float(cell_m), tuple(sorted(reach.items())))

    @classmethod
    def of_reach(cls, reach: Any) -> World:
        """From the program's own reach, of which only numbers are taken."""
        return cls.of(reach.layout.cells, reach.layout.cell_m, reach.to_dict())

    def number(self, name: str, default: float | None = None) -> Any:
        """A number of the reach."""
        return dict(self.reach).get(name, default)

    def corridor_fault(self, cell: Cell, degrees: float, standing: Board, slack: float = EPSILON) -> str | None:
        """What is wrong with an approach to `cell` at `degrees` about cell-to-base; None: nothing."""
        x, y = self.cells[cell]
        if abs(degrees) > self.number("half_fan_deg") + 1e-6:
            return f"{degrees} deg is outside the fan"
        to_base = math.hypot(x, y)
        ux, uy = -x / to_base, -y / to_base
        turn = math.radians(degrees)
        ux, uy = ux * math.cos(turn) - uy * math.sin(turn), ux * math.sin(turn) + uy * math.cos(turn)
        if (limit := self.number("max_yaw_deg")) is not None and -ux < math.cos(math.radians(limit)) - 1e-7:
            return f"heads more than {limit} deg from straight ahead"
        if (limit := self.number("lateral_limit_m")) is not None:
            front = min(x for x, _ in self.cells) - self.cell_m / 2 - self.number("staging_m", 0.0)
            if ux >= 0 or abs(y + (x - front) / -ux * uy) > limit + 1e-6:
                return "crosses the staging line too far aside"
        for other in standing - {cell}:
            dx, dy = self.cells[other][0] - x, self.cells[other][1] - y
            if dx * ux + dy * uy >= slack and abs(dx * uy - dy * ux) <= self.number("clearance_m") - slack:
                return f"blocked by the object on cell {other + 1}"
        return None

    def sectors(self) -> list[float]:
        """The approach directions, degrees."""
        half, n = self.number("half_fan_deg"), int(self.number("n_sectors"))
        return [half * (2 * sector / (n - 1) - 1) for sector in range(n)]


def fault(world: World, obstacles: Board, target: Cell, plan: dict[str, Any]) -> str | None:
    """What is wrong with a plan; None: nothing.

    Args:
        plan: status, moves ((pick, place, pick degrees, place degrees), cells from 0), target_direction_deg,
            optimal_moves.
    """
    board, seen = obstacles, {obstacles}
    for number, (pick, place, pick_deg, place_deg) in enumerate(plan["moves"], 1):
        others = (board - {pick}) | {target}
        if pick not in board or place in others or not 0 <= place < len(world.cells):
            return f"move {number}: {pick + 1} to {place + 1} is impossible"
        wrong = world.corridor_fault(pick, pick_deg, others) or world.corridor_fault(place, place_deg, others)
        if wrong:
            return f"move {number}: {wrong}"
        board = (board - {pick}) | {place}
        if board in seen:
            return f"move {number}: an earlier board again"
        seen.add(board)
    direction, optimum = plan["target_direction_deg"], plan["optimal_moves"]
    if (plan["status"] == "solved") != (direction is not None):
        return "solved without a direction to the target, or the reverse"
    if plan["status"] == "unsolvable" and plan["moves"]:
        return "moves of what has no solution"
    if optimum is not None and optimum > len(plan["moves"]):
        return f"{len(plan['moves'])} moves, fewer than the optimum {optimum}"
    return None if direction is None else world.corridor_fault(target, direction, board)


class Exhaustion:
    """Breadth-first search over all boards that moves lead to, without bounds or pruning (Appendix A, section 5.1)."""

    def __init__(self, world: World) -> None:
        self.cells = range(len(world.cells))
        # An approach direction is free where none of these cells is taken. The program counts a direction at the very
        # edge of an object as covered.
        self.blockers = [[self._blockers(world, cell, degrees) for degrees in world.sectors()] for cell in self.cells]
        self.accessible = cache(self._accessible)

    def fewest_moves(self, obstacles: Board, target: Cell) -> tuple[int | None, int]:
        """The fewest moves (None: no moves make the target accessible), and how many boards have been seen."""
        depth = {obstacles: 0}
        waiting = deque([obstacles])
        while waiting:
            board = waiting.popleft()
            if self.accessible(board, target):
                return depth[board], len(depth)
            for after in self.successors(board, target):
                if after not in depth:
                    depth[after] = depth[board] + 1
                    waiting.append(after)
        return None, len(depth)

    def successors(self, board: Board, target: Cell) -> Iterator[Board]:
        """The boards one move away."""
        for pick in board:
            others = (board - {pick}) | {target}
            if self.accessible(others, pick):
                for place in set(self.cells) - others - {pick}:
                    if self.accessible(others, place):
                        yield (board - {pick}) | {place}

    def _blockers(self, world: World, cell: Cell, degrees: float) -> Board:
        """The cells whose objects block an approach; all other ones where the arm itself cannot follow it."""
        fault = partial(world.corridor_fault, cell, degrees, slack=-1e-9)
        return frozenset(other for other in self.cells if fault(frozenset({other})))

    def _accessible(self, standing: Board, cell: Cell) -> bool:
        return any(cell not in blockers and not blockers & standing for blockers in self.blockers[cell])
