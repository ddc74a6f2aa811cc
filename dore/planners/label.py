"""What is known of a set of instances: how each ends, and the fewest moves."""

from __future__ import annotations

from typing import NamedTuple

from dore.errors import whole
from dore.planners.base import Planner
from dore.world.instances import InstanceSet
from dore.world.plan import Status


class Labels(NamedTuple):
    """One entry an instance."""

    status: list[Status]
    optimal_moves: list[int | None]
    """The proved fewest moves; None where no plan, or no proof, is known."""


def label(instances: InstanceSet, planner: Planner, batch_size: int = 1024) -> Labels:
    """Label a set with a planner that proves its plans, such as `Exact`.

    Args:
        batch_size: instances handed to the planner together.

    Raises:
        InputError: a batch size below 1.
        PlanError: a plan does not replay, which is a fault of the planner.
    """
    step = whole("batch_size", batch_size, 1)
    plans = [
        plan
        for first in range(0, len(instances), step)
        for plan in planner.plan(instances.batch(slice(first, first + step)))
    ]
    return Labels([plan.status for plan in plans], [plan.optimal_moves for plan in plans])
