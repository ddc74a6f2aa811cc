"""The fewest rearrangements, proved: A* over boards, many boards and many instances at a time."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import NamedTuple

import torch
from torch import Tensor

from dore.board import bit, unpack
from dore.errors import number, whole
from dore.plan import Plan, Status
from dore.planners.base import Draft, checked_plans
from dore.planners.bounds import locked, open_lanes, popcount, target_lanes
from dore.planners.layers import OutOfMemory, SeenBoards
from dore.reach import Reach
from dore.rules import lift, pickable, placeable, retrievable
from dore.sampling import Batch

GROUP = 128
"""Instances searched together; more would not make the tensors any faster."""
SMALLEST, LARGEST = 64, 2048
"""Boards expanded together: few while a solution may be near, then as many as were expanded so far."""
PAIRS = 8192
"""Picks whose places are worked out together, which bounds what is held for a moment."""
MEGABYTE = 2**20


class Exact:
    """A* (Hart, Nilsson and Raphael, 1968) over boards, with a proof either way.

    Unit costs; the bound of `bounds.open_lanes`; boards of equal f = moves so far + bound are expanded as layers of
    tensors, those nearest the goal first. Three things keep the layers thin, and none loses the optimum:

    - Partial expansion (Yoshizumi and others, 2000; Felner and others, 2012). A board is expanded with a budget of
      moves, m = f - moves so far: only moves after which some lane of the target, open within m, is blocked by at
      most m - 1 obstacles. No other move can begin a plan of m moves, since k obstacles need k moves. The board
      comes back with m + 1 when f has grown, until no move is left out.
    - Lazy bounds (Tolpin and others, 2013): a board is put in line by the count of obstacles on its best lane, and
      the dearer bound is worked out only when its turn comes; a board that fails waits for m + 1.
    - An obstacle is not moved twice in a row. Moves p -> q -> r of one obstacle are p -> r: each needs its two cells
      accessible and empty on the same board, the one without the obstacle. So the board after p -> r was one move
      nearer the start, and no shortest plan to it leads through q.

    The goal is seen one move early, when a move may be made after which m - 1 = 0 obstacles block a lane.

    Optimal: the bounds are admissible, all boards of smaller f have been exhausted before, and a board reached again
    by fewer moves is put in line again (`SeenBoards.add`), so that nothing rests on the bound being consistent.
    Unsolvable: either nothing was left to expand, or `bounds.locked` proves it from the start board alone. The
    go-back failure needs no care: a shortest plan visits no board twice.

    Args:
        max_nodes: gives an instance up after so many expanded boards.
        max_seconds: gives an instance up after so many wall seconds of its own; where many are planned together,
            the time of each step is shared out by the boards that each has in it.
        max_memory_mb: what the boards seen may take at a time, MiB. Where instances planned together need more,
            they are planned one by one; one that alone needs more is given up. Some 200 MiB for the step being
            worked on come on top.

    Raises:
        InputError: a budget of zero or below.
    """

    name = "exact"

    def __init__(self, reach: Reach, max_nodes: int, max_seconds: float, max_memory_mb: float) -> None:
        self.reach = reach
        self.max_nodes = whole("planner.exact.max_nodes", max_nodes, 1)
        self.max_seconds = number("planner.exact.max_seconds", max_seconds, above=0.0)
        self.max_memory_mb = number("planner.exact.max_memory_mb", max_memory_mb, above=0.0)
        self.lanes = target_lanes(reach)

    def plan(self, batch: Batch) -> list[Plan]:
        """All instances, `GROUP` at a time; see `Planner`."""
        drafts: list[Draft] = []
        for first in range(0, len(batch.target), GROUP):
            part = Batch(batch.board[first : first + GROUP], batch.target[first : first + GROUP])
            drafts += self._drafts(part)
        return checked_plans(self.reach, batch, drafts, self.name)

    def _drafts(self, part: Batch) -> list[Draft]:
        """Plan instances together, and those that do not fit into memory one by one."""
        search = _Search(self, part)
        try:
            search.run()
        except OutOfMemory:
            waiting = search.alive.nonzero().squeeze(-1).tolist()
            if len(part.target) > 1:
                done = search.drafts()
                for row in waiting:
                    (done[row],) = self._drafts(Batch(part.board[row, None], part.target[row, None]))
                return done
            search.give_up(f"memory budget: {search.seen.size} boards seen")
        return search.drafts()


class _Step(NamedTuple):
    """Boards that are expanded together, N of them."""

    place: Tensor
    """Int64[N]: where `SeenBoards` keeps them."""
    board: Tensor
    row: Tensor
    target: Tensor
    lanes: Tensor
    """Int64[N, D, W] of the targets."""
    blocking: Tensor
    """Int64[N, D]: obstacles on each lane."""


class _Search:
    """A* over some instances. `excess` is by how much f is above an instance's first bound."""

    def __init__(self, planner: Exact, start: Batch) -> None:
        self.planner, self.reach, self.start = planner, planner.reach, start
        n, device = len(start.target), start.board.device
        self.seen = SeenBoards(start.board.shape[-1], planner.max_memory_mb * MEGABYTE, device)
        self.line: dict[tuple[int, int], list[Tensor]] = {}
        self.taken = 0
        self.alive = torch.ones(n, dtype=torch.bool, device=device)
        self.expansions = torch.zeros(n, dtype=torch.int64, device=device)
        self.seconds = torch.zeros(n, dtype=torch.float64, device=device)
        self.goal = torch.full((n,), -1, dtype=torch.int64, device=device)
        """Of solved instances, where `seen` keeps the board that opens the target."""
        self.ended: list[tuple[Status, str]] = [(Status.GAVE_UP, "")] * n
        self.first_bound = popcount(start.board[:, None] & planner.lanes[start.target]).amin(-1)
        self.lock_tested = False
        self.clock = time.perf_counter()

    def run(self) -> None:
        """Search until every instance has ended.

        Raises:
            OutOfMemory: instances that have not ended are still alive.
        """
        board, target = self.start
        row = torch.arange(len(target), device=target.device)
        place = self.seen.add(board, row, torch.full_like(row, -1), torch.zeros_like(row))
        self._end(retrievable(self.reach, board, target), Status.SOLVED, "")
        for budget in self.first_bound.unique().tolist():
            self._queue(0, budget, place[self.first_bound[self.seen.row[place]] == budget])
        self._charge(row)
        while self.line and bool(self.alive.any()):
            excess, budget, place = self._next()
            if excess > 0 and not self.lock_tested:
                self._test_locks()
            if len(place):
                self._work(excess, budget, place)
                self._spend()
        seen = self.seen.row[: self.seen.size].bincount(minlength=len(row)).tolist()
        for left in self.alive.nonzero().squeeze(-1).tolist():
            self._end(row == left, Status.UNSOLVABLE, f"all {seen[left]} boards that can be reached are exhausted")

    def give_up(self, why: str) -> None:
        """End what is alive without a proof."""
        self._end(self.alive.clone(), Status.GAVE_UP, why)

    def drafts(self) -> list[Draft]:
        """What was found for each instance, one that is still alive as given up."""
        solved = [status is Status.SOLVED for status, _ in self.ended]
        moves = self.seen.moves_to(torch.where(torch.tensor(solved, device=self.goal.device), self.goal, -1))
        return [
            Draft(made, status, seconds, expansions, len(made) if status is Status.SOLVED else None, why)
            for made, (status, why), seconds, expansions in zip(
                moves, self.ended, self.seconds.tolist(), self.expansions.tolist(), strict=True
            )
        ]

    def _test_locks(self) -> None:
        """End the instances that no search is needed for; a test that most are solved without."""
        self.lock_tested = True
        shut = self.alive & locked(self.reach, *self.start)
        self._end(shut, Status.UNSOLVABLE, "1 board seen: what blocks the target can never be reached")

    def _work(self, excess: int, budget: int, place: Tensor) -> None:
        """Expand boards with a budget; put their successors in line, and themselves unless nothing is left out."""
        seen = self.seen
        step = self._step(place)
        is_open = open_lanes(self.reach, step.board, step.target, step.lanes, step.blocking, budget)
        some = is_open.any(-1)
        self._queue(excess + 1, budget + 1, place[~some])
        expanded, is_open = _Step(*(field[some] for field in step)), is_open[some]
        again = seen.done[expanded.place] > 0
        self.expansions.index_add_(0, expanded.row, (~again).long())
        for board, source in self._successors(expanded, is_open, again, budget):
            row, parent = expanded.row[source], expanded.place[source]
            new = seen.add(board, row, parent, seen.moves[parent] + 1)
            if budget > 1:
                self._queue(excess, budget - 1, new)
            elif len(new):
                self.goal[seen.row[new]] = new
                self._end(self.goal >= 0, Status.SOLVED, "")
        seen.done[expanded.place] = budget
        complete = (is_open & (expanded.blocking <= budget - 2)).any(-1)
        self._queue(excess + 1, budget + 1, expanded.place[~complete])
        self._charge(step.row)

    def _successors(self, step: _Step, is_open: Tensor, again: Tensor, budget: int) -> Iterator[tuple[Tensor, Tensor]]:
        """What the moves that a budget allows lead to: Int64[M, W], and Int64[M] from which board of the step.

        Boards that are expanded `again` leave out what they surely gave with the budget before.
        """
        near = is_open & (step.blocking < budget)
        useful = _union(torch.where(near[..., None], -1, torch.where(is_open[..., None], step.lanes, 0)))
        pick = pickable(self.reach, step.board, step.target)
        pick &= unpack(useful & ~self._just_placed(step.place), self.reach.n_cells)
        source, cell = pick.nonzero(as_tuple=True)
        for some, picked in zip(source.split(PAIRS), cell.split(PAIRS), strict=True):
            lifted = lift(step.board[some], picked)
            lanes, blocking = step.lanes[some], step.blocking[some]
            left = blocking - (bit(picked, lifted.shape[-1])[:, None] & lanes).ne(0).any(-1).long()
            given = again[some][:, None] & (blocking < budget - 1)
            useful = _places(lanes, left, is_open[some], budget) & ~_places(lanes, left, given, budget - 1)
            place = placeable(self.reach, lifted, step.target[some])
            place &= unpack(useful & ~step.board[some], self.reach.n_cells)
            pair, cell = place.nonzero(as_tuple=True)
            yield lifted[pair] | bit(cell, lifted.shape[-1]), some[pair]

    def _step(self, place: Tensor) -> _Step:
        board, row = self.seen.board[place], self.seen.row[place]
        target = self.start.target[row]
        lanes = self.planner.lanes[target]
        return _Step(place, board, row, target, lanes, popcount(board[:, None] & lanes))

    def _just_placed(self, place: Tensor) -> Tensor:
        """Int64[N, W]: the obstacle that the move to each board put down; none on a start board."""
        parent = self.seen.parent[place]
        before = self.seen.board[parent.clamp_min(0)]
        return torch.where((parent >= 0)[:, None], self.seen.board[place] & ~before, 0)

    def _queue(self, excess: int, budget: int, place: Tensor) -> None:
        """Put boards in line."""
        if len(place):
            self.line.setdefault((excess, budget), []).append(place)

    def _next(self) -> tuple[int, int, Tensor]:
        """The boards to expand now: least f, then least budget; latest first."""
        excess, budget = key = min(self.line)
        waiting = torch.cat(self.line.pop(key))
        size = min(LARGEST, max(SMALLEST, self.taken))
        self._queue(excess, budget, waiting[:-size])
        place = waiting[-size:]
        self.taken += len(place)
        row = self.seen.row[place]
        # A board that was reached by fewer moves meanwhile stands in line elsewhere too.
        current = self.seen.moves[place] == self.first_bound[row] + excess - budget
        return excess, budget, place[current & self.alive[row]]

    def _charge(self, row: Tensor) -> None:
        """Share the time since the last charge among Int64[N] rows."""
        now = time.perf_counter()
        self.seconds += row.bincount(minlength=len(self.seconds)) * ((now - self.clock) / len(row))
        self.clock = now

    def _spend(self) -> None:
        """Give up the instances whose budget is spent."""
        self._end(self.expansions >= self.planner.max_nodes, Status.GAVE_UP, "node budget")
        self._end(self.seconds >= self.planner.max_seconds, Status.GAVE_UP, "time budget")

    def _end(self, rows: Tensor, status: Status, why: str) -> None:
        """End those of Bool[n] instances that are alive."""
        for row in (rows & self.alive).nonzero().squeeze(-1).tolist():
            self.ended[row] = (status, why)
            self.alive[row] = False


def _places(lanes: Tensor, left: Tensor, is_open: Tensor, budget: int) -> Tensor:
    """Int64[P, W]: where a lifted obstacle may go so that an open lane is blocked by less than `budget` after.

    lanes: Int64[P, D, W]; left: Int64[P, D], how many block each after the lift.
    """
    anywhere = is_open & (left < budget - 1)
    beside = is_open & (left == budget - 1)
    return _union(torch.where(anywhere[..., None], -1, torch.where(beside[..., None], ~lanes, 0)))


def _union(words: Tensor) -> Tensor:
    """Int64[N, W] of Int64[N, D, W]."""
    union = words[:, 0]
    for more in words.unbind(1)[1:]:
        union = union | more
    return union
