"""Exact search, and a beam guided by a trained network where that takes long."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass

import torch

from dore.errors import flag, number, whole
from dore.planners.base import Planner, RawPlan
from dore.planners.beam import Beam, Shape
from dore.planners.compiled import raw_plan_of
from dore.planners.priors import Values, prior_of
from dore.planners.shorten import shortened
from dore.world.kernels import slices
from dore.world.kernels.search import search
from dore.world.kernels.slices import Limits
from dore.world.kernels.tables import unsigned
from dore.world.plan import Status
from dore.world.problem import Batch
from dore.world.reach import Reach

BEAM_SHARE = 0.1
"""The share of the budget left by the first exact search that the beam may use."""


class Guided(Planner):
    """Three searches of an instance within one budget: a brief exact one, a beam, and exact search for the rest.

    Most boards are decided by the first, with a proof (`dore.planners.exact`). The beam (`dore.planners.beam`) keeps
    the `width` most probable boards of each layer, by a prior over picks and places. Its plans are not proved to
    be the shortest, unless they are as short as the exact search's lower bound. What it does not solve, and with
    `improve` what it solves without a proof, goes to the exact search again.

    Args:
        reach: may differ from the one trained on.
        model: a run directory or a model file; None: the one in the package, which serves every layout.
        values: what moves are ranked by: the model's networks, the corridor costs, or a random order.
        temperature: divides the networks' values, which are then logits of probabilities.
        width, picks, places: boards of a layer, picks of a board and places of a pick that the beam keeps.
        exact_seconds: CPU seconds of the first exact search.
        improve: whether the exact search goes on for a shorter plan until the budget is spent.
        max_nodes: gives up on an instance after this many expanded boards.
        max_seconds: gives up on an instance after this many CPU seconds of its own.
        max_memory_mb: what the boards seen of an instance by the exact search may take, MiB.
        seed: of `values=random`.

    Raises:
        InputError: what `Learned` raises, or a value outside its domain.
    """

    name = "guided"
    group = 64

    def __init__(
        self,
        reach: Reach,
        model: str | os.PathLike[str] | None,
        values: Values,
        temperature: float,
        width: int,
        picks: int,
        places: int,
        exact_seconds: float,
        improve: bool,
        max_nodes: int,
        max_seconds: float,
        max_memory_mb: float,
        seed: int,
    ) -> None:
        self.reach = reach
        self.shape = Shape(width, picks, places).checked("planners.guided")
        self.exact_seconds = number("planners.guided.exact_seconds", exact_seconds, above=0.0, at_most=1e7)
        self.improve = flag("planners.guided.improve", improve)
        self.limits = Limits(
            seconds=number("planners.guided.max_seconds", max_seconds, above=0.0, at_most=1e7),
            nodes=whole("planners.guided.max_nodes", max_nodes, 1),
            megabytes=number("planners.guided.max_memory_mb", max_memory_mb, above=0.0, at_most=1e7),
        )
        self.prior = prior_of("planners.guided", reach, values, model, temperature, seed)
        # Compiles what is not compiled yet, so that no plan's time holds that.
        nothing = torch.empty(0, dtype=torch.int64)
        self._exact(Batch(nothing.view(0, reach.n_words), nothing), self.limits)
        with torch.inference_mode():
            self.prior.pick_values(nothing.view(0, reach.n_words), nothing)

    def raw_plans(self, batch: Batch) -> list[RawPlan]:
        """Search them one after the other where the search is exact, together in the beam."""
        seconds = min(self.exact_seconds, self.limits.seconds)
        tries = [_Try(*one) for one in self._exact(batch, self.limits._replace(seconds=seconds))]
        if led := [row for row, one in enumerate(tries) if one.plan.status is Status.GAVE_UP and self._left(one)]:
            self._lead(Batch(batch.board[led], batch.target[led]), [tries[row] for row in led])
        for row in led:
            one = tries[row]
            solved = one.plan.status is Status.SOLVED
            if one.again and (left := self._left(one)) and not (solved and (one.proved or not self.improve)):
                ((plan, *_),) = self._exact(Batch(batch.board[row, None], batch.target[row, None]), left)
                one.add(plan)
        return [one.plan for one in tries]

    def _exact(self, batch: Batch, limits: Limits) -> list[tuple[RawPlan, float, bool]]:
        """A plan of each instance, its CPU seconds, and whether more of them would help."""
        began = time.perf_counter()
        target = batch.target.cpu().numpy()
        found = slices.run(search, self.reach.table, unsigned(batch.board), target, limits)
        share = (time.perf_counter() - began) / max(1, int(found.cpu_ns.sum()))
        again = found.outcome == slices.OUT_OF_TIME
        return [(raw_plan_of(found, row, share), found.cpu_ns[row] / 1e9, again[row]) for row in range(len(target))]

    def _lead(self, batch: Batch, tries: list[_Try]) -> None:
        """The beam."""
        left = [self._left(one) or self.limits for one in tries]
        seconds = [BEAM_SHARE * limits.seconds for limits in left]
        beam = Beam(self.reach, self.prior, batch, self.shape, [limits.nodes for limits in left], seconds)
        plans, cpu_s = zip(*beam.raw_plans(), strict=True)
        for one, plan, spent in zip(tries, shortened(self.reach, batch, plans), cpu_s, strict=True):
            one.cpu_s += spent
            one.add(plan)

    def _left(self, one: _Try) -> Limits | None:
        """What is left of the budget; None: nothing."""
        seconds, nodes = self.limits.seconds - one.cpu_s, self.limits.nodes - one.plan.expansions
        return self.limits._replace(seconds=seconds, nodes=nodes) if seconds > 0 and nodes > 0 else None


@dataclass
class _Try:
    """What is known of an instance. cpu_s: spent; again: more exact search may decide it."""

    plan: RawPlan
    cpu_s: float
    again: bool

    @property
    def proved(self) -> bool:
        """Whether no plan is shorter."""
        return self.plan.optimal_moves is not None

    def add(self, found: RawPlan) -> None:
        """What another search has found: it says more only if it has decided the instance."""
        seconds = self.plan.planning_s + found.planning_s
        expansions = self.plan.expansions + found.expansions
        bound = max(self.plan.lower_bound or 0, found.lower_bound or 0)
        if found.status is Status.GAVE_UP:
            kept = self.plan if self.plan.status is Status.SOLVED else self.plan._replace(lower_bound=bound)
        else:
            proved = found.optimal_moves is None and len(found.moves) == bound and found.status is Status.SOLVED
            reason = "" if found.status is Status.SOLVED else found.reason
            kept = found._replace(reason=reason, optimal_moves=bound if proved else found.optimal_moves)
        self.plan = kept._replace(planning_s=seconds, expansions=expansions)
