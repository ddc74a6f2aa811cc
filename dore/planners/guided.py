"""Search led by the Q-networks: near-optimal plans in milliseconds, and proofs that there is no plan."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass

import torch

from dore.errors import number, whole
from dore.planners.base import EXHAUSTED, LOCKED, Planner, RawPlan
from dore.planners.beam import Beam
from dore.planners.compiled import glance
from dore.planners.learned import Learned
from dore.world.episode import MAX_MOVES
from dore.world.kernels import slices
from dore.world.plan import Status
from dore.world.problem import Batch
from dore.world.reach import Reach

WIDER = 4
"""By how much a beam that found nothing, or may find a shorter plan, is widened."""


@dataclass
class _Attempt:
    """How far the work on one instance is. fewest: no plan is shorter; proved: of the moves, or that there are none."""

    fewest: int
    moves: list[tuple[int, int]] | None = None
    proved: bool = False
    refusal: str = ""
    """Why there is no plan, or none was found."""
    spent: str = ""
    """Which budget is, if one is."""
    over: bool = False
    expansions: int = 0
    seconds: float = 0.0

    def raw_plan(self) -> RawPlan:
        """What came of it."""
        if self.moves is not None:
            optimal = len(self.moves) if self.proved else None
            return RawPlan(self.moves, Status.SOLVED, self.seconds, self.expansions, optimal)
        status = Status.UNSOLVABLE if self.proved else Status.GAVE_UP
        return RawPlan([], status, self.seconds, self.expansions, reason=self.refusal)


class Guided(Planner):
    """Complete anytime beam search (Zhang, 1998) with Q-values as the heuristic.

    A layer holds the boards after one move more. As in Q* (Agostinelli and others, 2021), a move is ranked by the
    Q-value that the network gives it, so one pass ranks all places of a lifted obstacle and no board is made to be
    judged. The `width` most valued moves of an instance make the next layer; boards seen before are dropped. Whether
    a move makes the target accessible is not left to the network: every candidate is tested, so the first layer with a
    solution gives the shortest plan within the beam.

    If none is found the beam is widened and the search restarted, until a plan is found, or nothing had to be left
    out, which proves that there is none, or the budget is spent. What `glance` proves unsolvable is not searched. A
    plan as short as the fewest obstacles on any approach corridor of the target is optimal. A longer one may be
    improved by a wider beam for `improve_seconds`; exhausting the shorter plans proves it too.

    Args:
        reach: may differ from the one trained on.
        model: a run directory or a model file; None: the one in the package, which serves every layout.
        width: moves kept in each layer by the first search.
        max_nodes: gives up on an instance after this many expanded boards.
        max_seconds: gives up on an instance after this many wall seconds of its own.
        max_moves: longest plan that the first two searches look for; each one after them looks twice as far.
        max_memory_mb: what the boards seen may take at a time, MiB; instances searched when it runs out are given up.
        improve_seconds: looks for a shorter plan until this many wall seconds of an instance are spent; 0: never.

    Raises:
        InputError: what `Learned` raises, or a number outside its domain.
    """

    name = "guided"
    group = 64

    def __init__(
        self,
        reach: Reach,
        model: str | os.PathLike[str] | None,
        width: int,
        max_nodes: int,
        max_seconds: float,
        max_moves: int,
        max_memory_mb: float,
        improve_seconds: float,
    ) -> None:
        self.reach = reach
        self.agent = Learned(
            reach, model, max_moves=whole("planners.guided.max_moves", max_moves, 1, at_most=MAX_MOVES)
        ).agent
        self.width = whole("planners.guided.width", width, 1, at_most=4096)
        self.max_nodes = whole("planners.guided.max_nodes", max_nodes, 1)
        self.max_seconds = number("planners.guided.max_seconds", max_seconds, above=0.0, at_most=1e7)
        self.max_moves = max_moves
        self.max_megabytes = number("planners.guided.max_memory_mb", max_memory_mb, above=0.0, at_most=1e7)
        self.improve_seconds = number("planners.guided.improve_seconds", improve_seconds, above=-1e-12, at_most=1e7)

    def raw_plans(self, batch: Batch) -> list[RawPlan]:
        """Search them together until each is solved, refused or given up."""
        began = time.perf_counter()
        known = glance(self.reach, batch)
        searches = [_Attempt(fewest) for fewest in known.fewest.tolist()]
        for search, outcome in zip(searches, known.outcome.tolist(), strict=True):
            search.proved = search.over = outcome in (slices.SOLVED, slices.LOCKED)
            if outcome == slices.SOLVED:
                search.moves = []
            elif search.over:
                search.refusal = LOCKED
        width, longest = self.width, self.max_moves
        while alive := [row for row, search in enumerate(searches) if not search.over]:
            self._widen(batch, searches, alive, width, longest, began)
            share = (time.perf_counter() - began) / len(alive)
            for row in alive:
                searches[row].seconds += share
                self._judge(searches[row])
            began = time.perf_counter()
            # Wider before longer: what looks like no way in the beam is mostly a short one beside it.
            width, longest = width * WIDER, 2 * longest if width > WIDER * self.width else longest
        return [search.raw_plan() for search in searches]

    def _widen(
        self, start: Batch, searches: list[_Attempt], alive: list[int], width: int, longest: int, began: float
    ) -> None:
        """One beam for those that are alive: any plan, or a shorter one than is known."""
        ongoing = [searches[row] for row in alive]
        most = [longest if one.moves is None else len(one.moves) - 1 for one in ongoing]
        left = [(self.max_seconds if one.moves is None else self.improve_seconds) - one.seconds for one in ongoing]
        rows = torch.tensor(alive, device=start.target.device)
        part = Batch(start.board[rows], start.target[rows])
        limit, until = torch.tensor(most, device=rows.device), began + max(left) * len(alive)
        found = Beam(self.reach, self.agent.move_values, part, width, limit, self.max_megabytes, until).run()
        for one, moves, narrow, cut, expansions, boards, full in zip(ongoing, *found, strict=True):
            one.expansions += expansions
            if moves is not None:
                one.moves, one.proved = moves, len(moves) == one.fewest or len(moves) == 1
            elif one.moves is not None:
                one.proved = not narrow
            elif not narrow and not cut:
                one.proved, one.refusal = True, EXHAUSTED.format(boards)
            if full:
                one.spent = "memory budget"

    def _judge(self, search: _Attempt) -> None:
        """Whether the work on an instance is over."""
        if search.expansions >= self.max_nodes:
            search.spent = "node budget"
        elif search.seconds >= self.max_seconds:
            search.spent = "time budget"
        if search.moves is not None:
            search.over = search.proved or bool(search.spent) or search.seconds >= self.improve_seconds
        else:
            search.over = search.proved or bool(search.spent)
            search.refusal = search.refusal or search.spent
