"""Planners that consist of a compiled search."""

from __future__ import annotations

import time
from bisect import bisect_right
from collections.abc import Callable, Sequence
from typing import overload

import numpy as np

from dore.planners.base import EXHAUSTED, LOCKED, Planner, RawPlan, plan_of, refuse
from dore.world.histogram import pack
from dore.world.kernels import slices
from dore.world.kernels.search import search
from dore.world.kernels.slices import Limits
from dore.world.kernels.tables import unsigned
from dore.world.plan import Plan, Status
from dore.world.problem import Batch, Problem
from dore.world.reach import Reach
from dore.world.replayed import Moves, Replayed, replayed

STATUS = {slices.SOLVED: Status.SOLVED, slices.UNSOLVABLE: Status.UNSOLVABLE, slices.LOCKED: Status.UNSOLVABLE}
"""By outcome; all others: gave up."""
REASON = {
    slices.SOLVED: "",
    slices.UNSOLVABLE: EXHAUSTED,
    slices.LOCKED: LOCKED,
    slices.OUT_OF_TIME: "time budget",
    slices.OUT_OF_NODES: "node budget",
    slices.OUT_OF_MEMORY: "memory budget: {} boards seen",
    slices.TOO_LONG: f"more than {slices.MOST_MOVES - 1} moves are needed",
}


class Compiled(Planner):
    """A search over boards by a compiled kernel, one instance after the other."""

    kernel: Callable[..., int]
    group = 4096  # Room for plans is taken for all at once.

    def __init__(self, reach: Reach, limits: Limits) -> None:
        self.reach, self.limits = reach, limits
        # Compiles the kernel, or loads it, so that no plan's time holds that.
        slices.run(self.kernel, reach.table, np.empty((0, reach.n_words), np.uint64), np.empty(0, np.int64), limits)

    def find(self, batch: Batch) -> slices.Found:
        """What is found for many instances, as arrays, unchecked: some 150,000 small ones a second."""
        return self._search(unsigned(batch.board), batch.target.cpu().numpy())

    def raw_plans(self, batch: Batch) -> list[RawPlan]:
        """The plans of a batch; the wall time is divided in proportion to the CPU time that each took."""
        began = time.perf_counter()
        found = self.find(batch)
        share = _share(found, began)
        return [raw_plan_of(found, row, share) for row in range(len(batch.target))]

    def plan(self, batch: Batch) -> Sequence[Plan]:
        """As of any planner; but each plan is made into a `Plan` only when it is asked for."""
        return self._planned(unsigned(batch.board), batch.target.cpu().numpy())

    def plan_one(self, problem: Problem) -> Plan:
        """As `plan`, of one problem, without torch."""
        occupied = np.zeros((1, self.reach.n_cells), np.bool_)
        occupied[0, list(problem.scene.obstacles)] = True
        return self._planned(pack(occupied), np.array([problem.scene.target]))[0]

    def _search(self, boards: np.ndarray, targets: np.ndarray) -> slices.Found:
        return slices.run(self.kernel, self.reach.table, boards, targets, self.limits)

    def _planned(self, boards: np.ndarray, targets: np.ndarray) -> ReplayedPlans:
        """Plans for uint64[B, W] boards and int64[B] targets."""
        plans = ReplayedPlans(self.name)
        for first in range(0, len(targets), self.group):
            part = boards[first : first + self.group], targets[first : first + self.group]
            began = time.perf_counter()
            found = self._search(*part)
            share = _share(found, began)
            moves = Moves(found.moves, found.n_moves, found.outcome == slices.SOLVED)
            right = replayed(self.reach, *part, moves)
            plans.add(found, share, right)
            if (row := first + right.n_right) < len(plans):
                refuse(self.reach, boards[row], int(targets[row]), row, plans[row])
        return plans


def _share(found: slices.Found, began: float) -> float:
    """The wall seconds since `began` for each CPU nanosecond."""
    return (time.perf_counter() - began) / max(1, int(found.cpu_ns.sum()))


def raw_plan_of(found: slices.Found, row: int, share: float) -> RawPlan:
    """What was found for an instance; share: wall seconds for each CPU nanosecond."""
    outcome, n_moves, expansions, seen, fewest, ns = found.rows[row].tolist()
    status, cells = STATUS.get(outcome, Status.GAVE_UP), found.moves[row, : 2 * n_moves].tolist()
    return RawPlan(
        moves=list(zip(cells[::2], cells[1::2], strict=True)),
        status=status,
        planning_s=share * ns,
        expansions=expansions,
        optimal_moves=n_moves if status is Status.SOLVED else None,
        reason=REASON[outcome].format(seen),
        lower_bound=fewest if status is Status.GAVE_UP else None,
    )


class ReplayedPlans(Sequence[Plan]):
    """Replayed plans, kept as arrays; each `Plan` is made when it is first asked for."""

    def __init__(self, planner: str) -> None:
        self._planner = planner
        self._parts: list[tuple[slices.Found, float, Replayed]] = []
        self._firsts = [0]

    def add(self, found: slices.Found, share: float, right: Replayed) -> None:
        """Append what was found and replayed together; the room taken for longer plans is freed."""
        moves = found.moves[:, : right.sectors.shape[1] - 1].copy()
        self._parts.append((found._replace(moves=moves), share, right))
        self._firsts.append(len(self) + len(moves))

    def __len__(self) -> int:
        return self._firsts[-1]

    @overload
    def __getitem__(self, index: int) -> Plan: ...

    @overload
    def __getitem__(self, index: slice) -> list[Plan]: ...

    def __getitem__(self, index: int | slice) -> Plan | list[Plan]:
        rows = range(len(self))[index]
        if isinstance(rows, range):
            return [self[row] for row in rows]
        part = bisect_right(self._firsts, rows) - 1
        found, share, right = self._parts[part]
        row = rows - self._firsts[part]
        return plan_of(raw_plan_of(found, row, share), right, row, self._planner)


def glance(reach: Reach, batch: Batch) -> slices.Found:
    """What is known of instances before any search, by `outcome`: SOLVED, the target is accessible, or LOCKED, no plan
    opens it, because what blocks it can never be reached (room may be lacking elsewhere too). `fewest`: the obstacles
    on the target's best corridor; each must be moved, so no plan is shorter.
    """
    limits = Limits(seconds=1e6, nodes=0, megabytes=1024.0)
    return slices.run(search, reach.table, unsigned(batch.board), batch.target.cpu().numpy(), limits)
