"""The paper's baseline: clear the straight way to the target (section 6.1, after Dogar et al.)."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from enum import StrEnum

import torch
from torch import Tensor

from dore.errors import InputError, flag, number, whole
from dore.planners.base import Planner, RawPlan
from dore.world import board as boards
from dore.world.episode import MAX_MOVES
from dore.world.layout import Layout
from dore.world.plan import Status
from dore.world.problem import Batch, cell_id
from dore.world.reach import Reach
from dore.world.rules import legal_places, lift


class GiveUp(StrEnum):
    """Why the baseline cannot continue."""

    NO_PLACE = "no place"
    """No cell is open to the picked obstacle, or each would bring an earlier board back."""
    NO_APPROACH = "no approach"
    """Every approach to an obstacle or the target is blocked by the target or by an obstacle that waits for it."""
    BUDGET = "move budget"
    """`max_moves` moves are made."""


KEY = "planners.straight_line"
"""Where a config has this planner's settings."""


class StraightLine(Planner):
    """Removes everything in the straight corridor from the end-effector's start to the target, nearest first.

    The corridor is a rectangle from the start to the cell's centre. An obstacle in it that is not accessible has
    its own corridor cleared first. Each goes to the accessible empty cell farthest from the target, even where
    that cell lies in the corridor and is cleared again later. Accessible means by the modified VFH+ (`Reach`).

    As in the paper, every obstacle of the corridor goes, even where the target is accessible before. Only an
    instance whose target is accessible at the start is solved with no moves.

    Not in the paper, which does not say:
    - where the corridor is clear and VFH+ still finds no way (it needs room beside the cell), what blocks the
      approach nearest the straight line is removed too, unless the target is what blocks it;
    - where it cannot continue, it takes the target if that is accessible by then;
    - no move brings an earlier board back; with the move budget, this keeps the method from looping;
    - of two farthest cells the one with the lower id is taken.

    Args:
        start_x_m, start_y_m: the end-effector's start in the robot's base frame, metres.
        corridor_m: half width of the corridor, which obstacles' centres must stay out of, metres; None: the
            reach's clearance.
        avoid_corridors: put nothing into a corridor that is being cleared while there is another place. The
            paper's rule has no such exception (False); with it the baseline needs fewer moves.
        max_moves: give up after this many moves.

    Raises:
        InputError: a start beyond the layout's front edge, or a parameter outside its domain.
    """

    name = "straight_line"
    group = 1

    def __init__(
        self,
        reach: Reach,
        start_x_m: float,
        start_y_m: float,
        corridor_m: float | None,
        avoid_corridors: bool,
        max_moves: int,
    ) -> None:
        self.reach = reach
        self.start_m = (
            number(f"{KEY}.start_x_m", start_x_m, above=-10.0, at_most=10.0),
            number(f"{KEY}.start_y_m", start_y_m, above=-10.0, at_most=10.0),
        )
        if self.start_m[0] >= reach.layout.front_m:
            raise InputError(
                f"{KEY}.start_x_m: got {start_x_m:g}, want less than the front edge {reach.layout.front_m:g}"
            )
        self.corridor_m = (
            reach.clearance_m
            if corridor_m is None
            else number(f"{KEY}.corridor_m", corridor_m, above=0.0, at_most=10.0)
        )
        self.avoid_corridors = flag(f"{KEY}.avoid_corridors", avoid_corridors)
        self.max_moves = whole(f"{KEY}.max_moves", max_moves, 1, at_most=MAX_MOVES)
        self.corridors = _corridors(reach.layout, self.start_m, self.corridor_m)
        self.approaches = _approaches(reach, self.start_m)
        self.farthest = _farthest(reach.layout)

    def raw_plans(self, batch: Batch) -> list[RawPlan]:
        """The plan of one instance."""
        board, target = batch
        began = time.perf_counter()
        clearing = _Clearing(self, board, target)
        status, reason = Status.SOLVED, ""
        try:
            if not clearing.accessible[clearing.target]:
                clearing.clear(clearing.target, waiting=frozenset(), keep=frozenset())
        except _Stuck as stuck:
            if not clearing.accessible[clearing.target]:
                status, reason = Status.GAVE_UP, str(stuck)
        taken = time.perf_counter() - began
        return [RawPlan(clearing.moves, status, taken, expansions=len(clearing.moves), reason=reason)]


class _Stuck(Exception):
    """Ends the work on one instance; its text is the reason."""

    def __init__(self, why: GiveUp, cell: int) -> None:
        super().__init__(f"{why}: cell {cell_id(cell)}")


class _Clearing:
    """One instance while the baseline works on it."""

    def __init__(self, planner: StraightLine, board: Tensor, target: Tensor) -> None:
        self.planner = planner
        self.target_id = target
        self.target = int(target)
        self.moves: list[tuple[int, int]] = []
        self.visited = board[:, None]
        self._look(board)

    def clear(self, cell: int, waiting: frozenset[int], keep: frozenset[int]) -> None:
        """Remove what stands in the corridor to `cell`, and then what blocks the approach nearest it.

        waiting: obstacles that can only go after this one; keep: cells of the corridors being cleared.

        Raises:
            _Stuck: it cannot be done.
        """
        corridor = self.planner.corridors[cell]
        keep = keep.union(corridor)
        while (obstacle := self._first(corridor, waiting)) is not None:
            self._remove(obstacle, waiting, keep)
        while not self.accessible[cell]:
            approach = self._nearest_approach(cell, waiting)
            obstacle = self._first(approach, waiting)
            if obstacle is None:
                raise _Stuck(GiveUp.NO_APPROACH, cell)
            self._remove(obstacle, waiting, keep.union(approach))

    def _first(self, cells: tuple[int, ...], waiting: frozenset[int]) -> int | None:
        """The first of `cells` with an obstacle that may go now."""
        return next((cell for cell in cells if cell in self.obstacles and cell not in waiting), None)

    def _remove(self, obstacle: int, waiting: frozenset[int], keep: frozenset[int]) -> None:
        """Put an obstacle out of the way, after clearing the way to it."""
        if not self.accessible[obstacle]:
            self.clear(obstacle, waiting | {obstacle}, keep)
        if len(self.moves) >= self.planner.max_moves:
            raise _Stuck(GiveUp.BUDGET, obstacle)
        pick = torch.tensor([obstacle], device=self.visited.device)
        place = self._place(obstacle, pick, keep)
        self.moves.append((obstacle, place))
        board = self.visited[:, -1]
        moved = lift(board, pick) | boards.bit(torch.full_like(pick, place), board.shape[-1])
        self.visited = torch.cat([self.visited, moved[:, None]], 1)
        self._look(moved)

    def _place(self, obstacle: int, pick: Tensor, keep: frozenset[int]) -> int:
        """Where the obstacle goes: the open cell farthest from the target."""
        planner = self.planner
        allowed = legal_places(planner.reach, self.visited[:, -1], self.target_id, self.visited, pick)[0].tolist()
        places = [cell for cell in planner.farthest[self.target] if allowed[cell]]
        if not places:
            raise _Stuck(GiveUp.NO_PLACE, obstacle)
        if planner.avoid_corridors:
            places = [cell for cell in places if cell not in keep] or places
        return places[0]

    def _nearest_approach(self, cell: int, waiting: frozenset[int]) -> tuple[int, ...]:
        """The cells of the approach nearest the straight line that can be cleared."""
        for approach in self.planner.approaches[cell]:
            if self.target not in approach and not waiting.intersection(self.obstacles.intersection(approach)):
                return approach
        raise _Stuck(GiveUp.NO_APPROACH, cell)

    def _look(self, board: Tensor) -> None:
        """Update where the obstacles are and what the hand can reach."""
        reach = self.planner.reach
        self.obstacles = set(boards.unpack(board[0], reach.n_cells).nonzero().squeeze(-1).tolist())
        standing = board | boards.bit(self.target_id, board.shape[-1])
        self.accessible: list[bool] = reach.accessible_packed(standing)[0].tolist()


def _corridors(layout: Layout, start_m: tuple[float, float], half_width_m: float) -> list[tuple[int, ...]]:
    """For each cell the others whose centres lie in the rectangle from the start to it, nearest first."""
    start = torch.tensor(start_m, dtype=torch.float64)
    to_cell = layout.centres - start
    length = to_cell.norm(dim=-1)
    along = to_cell @ to_cell.T / length[:, None]
    across = (to_cell[:, None, 0] * to_cell[None, :, 1] - to_cell[:, None, 1] * to_cell[None, :, 0]) / length[:, None]
    # A centre that lies on the edge up to rounding counts as inside on both sides, so that mirror images agree.
    inside = (along > 0) & (along <= length[:, None] + 1e-9) & (across.abs() <= half_width_m + 1e-9)
    inside.fill_diagonal_(False)
    return [_nearest_first(cells.nonzero().squeeze(-1).tolist(), length) for cells in inside]


def _approaches(reach: Reach, start_m: tuple[float, float]) -> list[list[tuple[int, ...]]]:
    """For each cell the blocking sets of its allowed sectors, the sector nearest the start's direction first."""
    start = torch.tensor(start_m, dtype=torch.float64)
    length = (reach.layout.centres - start).norm(dim=-1)
    approaches = []
    for cell, (x, y) in enumerate(reach.layout.cells):
        straight = math.atan2(start_m[1] - y, start_m[0] - x) - math.atan2(-y, -x)
        off = (reach.sectors_deg.cpu().deg2rad() - straight).cos()
        covered = boards.unpack(reach.blockers[cell].cpu(), reach.n_cells)
        allowed = [
            s for s in off.argsort(descending=True, stable=True).tolist() if bool(reach.allowed_sectors[cell, s])
        ]
        approaches.append([_nearest_first(covered[s].nonzero().squeeze(-1).tolist(), length) for s in allowed])
    return approaches


def _farthest(layout: Layout) -> list[tuple[int, ...]]:
    """For each cell all cells, the farthest from it first; of two as far (to a nanometre) the lower id."""
    distance = torch.cdist(layout.centres, layout.centres)
    return [_nearest_first(range(layout.n_cells), -row) for row in distance]


def _nearest_first(cells: Iterable[int], distance: Tensor) -> tuple[int, ...]:
    """Cells by their distance to the start; of two as near (to a nanometre) the lower id."""
    return tuple(sorted(cells, key=lambda k: (round(float(distance[k]), 9), k)))
