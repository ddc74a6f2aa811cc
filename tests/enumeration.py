"""The fewest moves by plain enumeration, with a geometry of its own: no table, no tensors, no bounds."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from functools import cache

from dore.world.reach import Reach

Board = frozenset[int]


class Enumeration:
    """Breadth-first search over sets of obstacle cells, straight from the paper's text (Appendix A, section 5.1)."""

    def __init__(self, reach: Reach) -> None:
        self.cells = reach.layout.cells
        self.r = reach.clearance_m
        step = 2 * reach.half_fan_deg / (reach.n_sectors - 1)
        self.sectors = [math.radians(-reach.half_fan_deg + step * sector) for sector in range(reach.n_sectors)]
        self.covers = cache(self._covers)
        self.accessible = cache(self._accessible)

    def fewest_moves(self, obstacles: Board, target: int) -> tuple[int | None, int]:
        """The fewest moves (None: there is no plan), and how many boards have been seen."""
        depth = {obstacles: 0}
        waiting = deque([obstacles])
        while waiting:
            board = waiting.popleft()
            if self.accessible(board, target):
                return depth[board], len(depth)
            for after in self.moves(board, target):
                if after not in depth:
                    depth[after] = depth[board] + 1
                    waiting.append(after)
        return None, len(depth)

    def moves(self, board: Board, target: int) -> Iterator[Board]:
        """The boards one legal move away."""
        for pick in board:
            others = (board - {pick}) | {target}
            if self.accessible(others, pick):
                for place in set(range(len(self.cells))) - others - {pick}:
                    if self.accessible(others, place):
                        yield (board - {pick}) | {place}

    def _accessible(self, standing: Board, cell: int) -> bool:
        """Whether an approach sector of `cell` is covered by no object."""
        return any(
            not any(self.covers(cell, sector, other) for other in standing) for sector in range(len(self.sectors))
        )

    def _covers(self, cell: int, sector: int, other: int) -> bool:
        """Whether what stands on `other` covers a sector: the angle between them is at most asin(r / distance)."""
        (x, y), (x_other, y_other) = self.cells[cell], self.cells[other]
        distance = math.dist((x, y), (x_other, y_other))
        half_width = math.pi / 2 if self.r >= distance else math.asin(self.r / distance)
        heading = math.atan2(-y, -x) + self.sectors[sector]
        along = ((x_other - x) * math.cos(heading) + (y_other - y) * math.sin(heading)) / distance
        return math.acos(max(-1.0, min(1.0, along))) <= half_width + 1e-9
