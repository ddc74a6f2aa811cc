"""A beam alone: what a prior's probabilities find without exact search."""

from __future__ import annotations

import os

from dore.errors import number, whole
from dore.planners.base import Planner, RawPlan
from dore.planners.beam import Beam, Shape
from dore.planners.priors import Values, prior_of
from dore.planners.shorten import shortened
from dore.world.problem import Batch
from dore.world.reach import Reach


class BeamSearch(Planner):
    """Beam search by a prior over picks and places (`dore.planners.beam`); `Guided` adds exact search to it.

    Needless moves are left out of its plans (`dore.planners.shorten`). They are not proved to be the shortest, and it
    proves no instance unsolvable.

    Args:
        reach: may differ from the one trained on.
        model: a run directory or a model file; None: the one in the package, which serves every layout.
        values, temperature, seed: see `prior_of`.
        width, picks, places: see `Shape`.
        max_nodes: gives up on an instance after this many expanded boards.
        max_seconds: gives up on an instance after this many CPU seconds of its own.

    Raises:
        InputError: what `Learned` raises, or a value outside its domain.
    """

    name = "beam"
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
        max_nodes: int,
        max_seconds: float,
        seed: int,
    ) -> None:
        self.reach = reach
        self.shape = Shape(width, picks, places).checked("planners.beam")
        self.max_nodes = whole("planners.beam.max_nodes", max_nodes, 1)
        self.max_seconds = number("planners.beam.max_seconds", max_seconds, above=0.0, at_most=1e7)
        self.prior = prior_of("planners.beam", reach, values, model, temperature, seed)

    def raw_plans(self, batch: Batch) -> list[RawPlan]:
        """Search all instances together, and shorten their plans."""
        n = len(batch.target)
        beam = Beam(self.reach, self.prior, batch, self.shape, [self.max_nodes] * n, [self.max_seconds] * n)
        return shortened(self.reach, batch, [plan for plan, _ in beam.raw_plans()])
