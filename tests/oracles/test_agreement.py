"""The compiled exact search against the search in tensors, on random boards."""

from __future__ import annotations

import pytest

from dore.planners.exact import Exact
from dore.world.generator import Difficulty
from dore.world.instances import InstanceSet
from dore.world.layout import Layout
from dore.world.plan import Status
from dore.world.reach import Reach
from tests.drawings import PUBLISHED, WIDE_HAND
from tests.oracles.torch_exact import TorchExact


def check(rows: int, cols: int, keys: dict[str, float], n: int) -> int:
    """How many of 6 n boards of 10 to 60 % density both decide, all of them alike; each compiled plan is replayed."""
    reach = Reach(Layout.grid(rows, cols, 0.12), **keys)  # type: ignore[arg-type]
    ours, theirs = Exact(reach, 10**6, 2.0, 500.0), TorchExact(reach, 20_000, 2.0, 200.0)
    decided = 0
    for tenths in range(1, 7):
        n_obstacles = max(1, tenths * rows * cols // 10)
        batch = InstanceSet.generate(reach, n, Difficulty(n_obstacles, n_obstacles), "test", tenths).batch()
        for one, other in zip(ours.plan(batch), theirs.raw_plans(batch), strict=True):
            if Status.GAVE_UP in (one.status, other.status):
                assert one.lower_bound is None or other.optimal_moves is None or one.lower_bound <= other.optimal_moves
            else:
                assert (one.status, one.optimal_moves) == (other.status, other.optimal_moves)
                decided += 1
    return decided


@pytest.mark.parametrize("keys", [WIDE_HAND, PUBLISHED], ids=["wide_hand", "published"])
def test_a_few_boards(keys: dict[str, float]) -> None:
    assert check(4, 5, keys, n=15) > 80


@pytest.mark.slow
@pytest.mark.parametrize("keys", [WIDE_HAND, PUBLISHED], ids=["wide_hand", "published"])
@pytest.mark.parametrize(("rows", "cols"), [(3, 6), (5, 5), (6, 6), (8, 8), (10, 10)])
def test_thousands_of_boards(rows: int, cols: int, keys: dict[str, float]) -> None:
    assert check(rows, cols, keys, n=340) > 1600
