"""A* over the boards of many instances at once, in layers of tensors. `Exact` says why it loses no optimum.

N denotes the boards of a step, n the instances, D the corridors of a target, W the words of a board.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import NamedTuple

import torch
from torch import Tensor

from dore.planners.base import EXHAUSTED, LOCKED, RawPlan
from dore.world.board import bit, count, unpack
from dore.world.plan import Status
from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.rules import accessibility, lift, retrievable
from tests.oracles.bounds import DeleteRelaxation, fewest_blocking
from tests.oracles.visited_set import SeenBoards

SMALLEST, LARGEST = 128, 1024
"""Boards expanded together: few while a solution may be near, then as many as had that f before them."""
PAIRS = 2048
"""Picks whose places are computed together, which bounds the memory of a step."""


class SearchLimits(NamedTuple):
    """When to give an instance up; see `Exact`."""

    nodes: int
    seconds: float
    megabytes: float


class _Expansion(NamedTuple):
    """Boards that are expanded together, N of them."""

    place: Tensor
    """Int64[N]: where `SeenBoards` keeps them."""
    board: Tensor
    row: Tensor
    target: Tensor
    corridors: Tensor
    """Int64[N, D, W] of the targets."""
    blocking: Tensor
    """Int64[N, D]: obstacles on each corridor."""


class Search:
    """A* over some instances.

    Boards wait in `queue` under (excess, budget): by how much f is above their instance's first bound, and how many
    moves that leaves them.
    """

    def __init__(self, reach: Reach, relaxation: DeleteRelaxation, limits: SearchLimits, start: Batch) -> None:
        self.reach, self.relaxation, self.limits, self.start = reach, relaxation, limits, start
        n, device = len(start.target), start.board.device
        self.seen = SeenBoards(start.board.shape[-1], limits.megabytes, device)
        self.queue: dict[tuple[int, int], list[Tensor]] = {}
        self.excess, self.taken = 0, 0
        self.alive = torch.ones(n, dtype=torch.bool, device=device)
        self.expansions = torch.zeros(n, dtype=torch.int64, device=device)
        self.seconds = torch.zeros(n, dtype=torch.float64, device=device)
        self.goal = torch.full((n,), -1, dtype=torch.int64, device=device)
        """Of solved instances, where `seen` keeps the board that opens the target."""
        self.ended: list[tuple[Status, str]] = [(Status.GAVE_UP, "")] * n
        self.first_bound = fewest_blocking(reach, start)
        self.lock_tested = False
        self.clock = time.perf_counter()

    def run(self) -> None:
        """Search until every instance has ended.

        Raises:
            SeenBoardsFull: instances that have not ended are still alive.
        """
        board, target = self.start
        row = torch.arange(len(target), device=target.device)
        place = self.seen.add(board, row, torch.full_like(row, -1), torch.zeros_like(row))
        self._end(retrievable(self.reach, board, target), Status.SOLVED, "")
        for budget in self.first_bound.unique().tolist():
            self._queue(0, budget, place[self.first_bound[self.seen.row[place]] == budget])
        self._charge(row)
        while self.queue and bool(self.alive.any()):
            excess, budget, place = self._next()
            if excess > 0 and not self.lock_tested:
                self._test_locks()
            if len(place):
                self._work(excess, budget, place)
                self._spend()
        for left in self.alive.nonzero().squeeze(-1).tolist():
            self._end(row == left, Status.UNSOLVABLE, EXHAUSTED.format(self.seen.count(left)))

    def give_up(self, why: str) -> None:
        """End what is alive without a proof."""
        self._end(self.alive.clone(), Status.GAVE_UP, why)

    def raw_plans(self) -> list[RawPlan]:
        """What was found for each instance, one that is still alive as given up."""
        solved = [status is Status.SOLVED for status, _ in self.ended]
        moves = self.seen.moves_to(torch.where(torch.tensor(solved, device=self.goal.device), self.goal, -1))
        return [
            RawPlan(made, status, seconds, expansions, len(made) if status is Status.SOLVED else None, why)
            for made, (status, why), seconds, expansions in zip(
                moves, self.ended, self.seconds.tolist(), self.expansions.tolist(), strict=True
            )
        ]

    def _test_locks(self) -> None:
        """End the instances that no search is needed for; a test that most are solved without."""
        self.lock_tested = True
        locked = self.alive & self.relaxation.locked(*self.start)
        self._end(locked, Status.UNSOLVABLE, LOCKED)

    def _work(self, excess: int, budget: int, place: Tensor) -> None:
        """Expand boards with a budget; queue their successors, and themselves unless nothing is left out."""
        seen = self.seen
        step = self._step(place)
        is_open = self.relaxation.open_corridors(step.board, step.target, step.corridors, step.blocking, budget)
        some = is_open.any(-1)
        self._queue(excess + 1, budget + 1, place[~some])
        expanded, is_open = _Expansion(*(field[some] for field in step)), is_open[some]
        self.expansions.index_add_(0, expanded.row, (seen.done[expanded.place] == 0).long())
        for board, source in self._successors(expanded, is_open, budget):
            row, parent = expanded.row[source], expanded.place[source]
            new = seen.add(board, row, parent, seen.moves[parent] + 1)
            if budget > 1:
                self._queue(excess, budget - 1, new)
            elif len(new):
                self.goal[seen.row[new]] = new
                self._end(self.goal >= 0, Status.SOLVED, "")
            if self._over_time(step.row):
                break  # These boards' instances all end at the next `_spend`.
        seen.done[expanded.place] = budget
        complete = (is_open & (expanded.blocking <= budget - 2)).any(-1)
        self._queue(excess + 1, budget + 1, expanded.place[~complete])
        self._charge(step.row)

    def _successors(self, step: _Expansion, is_open: Tensor, budget: int) -> Iterator[tuple[Tensor, Tensor]]:
        """What the moves that a budget allows lead to: Int64[M, W], and Int64[M] from which board of the step.

        is_open: Bool[N, D], the corridors that may be freed within the budget.
        """
        near = is_open & (step.blocking < budget)
        useful = _union(torch.where(near[..., None], -1, torch.where(is_open[..., None], step.corridors, 0)))
        pick = accessibility(self.reach, step.board, step.target).pick
        pick &= unpack(useful & ~self.seen.just_placed(step.place), self.reach.n_cells)
        source, cell = pick.nonzero(as_tuple=True)
        for some, picked in zip(source.split(PAIRS), cell.split(PAIRS), strict=True):
            lifted = lift(step.board[some], picked)
            corridors, blocking = step.corridors[some], step.blocking[some]
            left = blocking - (bit(picked, lifted.shape[-1])[:, None] & corridors).ne(0).any(-1).long()
            useful = _places(corridors, left, is_open[some], budget)
            place = accessibility(self.reach, lifted, step.target[some]).place
            place &= unpack(useful & ~step.board[some], self.reach.n_cells)
            pair, cell = place.nonzero(as_tuple=True)
            yield lifted[pair] | bit(cell, lifted.shape[-1]), some[pair]

    def _step(self, place: Tensor) -> _Expansion:
        board, row = self.seen.board[place], self.seen.row[place]
        target = self.start.target[row]
        corridors = self.relaxation.corridors_of(target)
        return _Expansion(place, board, row, target, corridors, count(board[:, None] & corridors))

    def _queue(self, excess: int, budget: int, place: Tensor) -> None:
        """Let boards wait for their turn."""
        if len(place):
            self.queue.setdefault((excess, budget), []).append(place)

    def _next(self) -> tuple[int, int, Tensor]:
        """The boards to expand now: least f, then least budget; latest first."""
        excess, budget = key = min(self.queue)
        if excess > self.excess:
            self.excess, self.taken = excess, 0
        waiting = torch.cat(self.queue.pop(key))
        size = min(LARGEST, max(SMALLEST, self.taken))
        self._queue(excess, budget, waiting[:-size])
        place = waiting[-size:]
        self.taken += len(place)
        row = self.seen.row[place]
        # A board that has since been reached by fewer moves is queued elsewhere too.
        current = self.seen.moves[place] == self.first_bound[row] + excess - budget
        return excess, budget, place[current & self.alive[row]]

    def _charge(self, row: Tensor) -> None:
        """Share the time since the last charge among Int64[N] rows."""
        now = time.perf_counter()
        self.seconds += row.bincount(minlength=len(self.seconds)) * ((now - self.clock) / len(row))
        self.clock = now

    def _over_time(self, row: Tensor) -> bool:
        """Whether the time since the last charge takes every instance among Int64[N] rows over its budget."""
        share = row.bincount(minlength=len(self.seconds)) * ((time.perf_counter() - self.clock) / len(row))
        late = self.seconds + share >= self.limits.seconds
        return bool(late[row].all())

    def _spend(self) -> None:
        """Give up the instances whose budget is spent."""
        self._end(self.expansions >= self.limits.nodes, Status.GAVE_UP, "node budget")
        self._end(self.seconds >= self.limits.seconds, Status.GAVE_UP, "time budget")

    def _end(self, rows: Tensor, status: Status, why: str) -> None:
        """End those of Bool[n] instances that are alive."""
        for row in (rows & self.alive).nonzero().squeeze(-1).tolist():
            self.ended[row] = (status, why)
            self.alive[row] = False


def _places(corridors: Tensor, left: Tensor, is_open: Tensor, budget: int) -> Tensor:
    """Int64[P, W]: where a lifted obstacle may go so that an open corridor is blocked by less than `budget` after.

    corridors: Int64[P, D, W]; left: Int64[P, D], how many block each after the lift.
    """
    anywhere = is_open & (left < budget - 1)
    beside = is_open & (left == budget - 1)
    return _union(torch.where(anywhere[..., None], -1, torch.where(beside[..., None], ~corridors, 0)))


def _union(words: Tensor) -> Tensor:
    """Int64[N, W] of Int64[N, D, W]."""
    union = words[:, 0]
    for more in words.unbind(1)[1:]:
        union = union | more
    return union
