"""The judge of plans refuses what is wrong, and passes what the planners make."""

from __future__ import annotations

from typing import Any

import pytest

from dore.world.layout import Layout
from dore.world.plan import Plan, Status
from dore.world.reach import Reach
from tests.trust import plans
from tests.trust.judge import Exhaustion, World, fault

LAYOUT = Layout.grid(3, 3, 0.12)
REACH = Reach(LAYOUT, 0.106, 30.0, 61, staging_m=0.07, lateral_limit_m=0.3, max_yaw_deg=60.0)
WORLD = World.of_reach(REACH)
BOARD, TARGET = frozenset({1, 4}), 7
PLAN: dict[str, Any] = {
    "status": "solved",
    "moves": [(1, 0, 0.0, 0.0), (4, 2, 0.0, 0.0)],
    "target_direction_deg": 0.0,
    "optimal_moves": 2,
}


def test_a_good_plan_passes() -> None:
    assert fault(WORLD, BOARD, TARGET, PLAN) is None


@pytest.mark.parametrize(
    "change",
    [
        {"moves": PLAN["moves"][:1]},
        {"moves": [(4, 2, 0.0, 0.0), (1, 0, 0.0, 0.0)]},
        {"moves": [(1, 7, 0.0, 0.0), *PLAN["moves"][1:]]},
        {"moves": [(1, 9, 0.0, 0.0), *PLAN["moves"][1:]]},
        {"moves": [(3, 0, 0.0, 0.0), *PLAN["moves"][1:]]},
        {"moves": [(1, 0, 31.0, 0.0), *PLAN["moves"][1:]]},
        {"moves": [(1, 0, 0.0, 0.0), (0, 1, 0.0, 0.0)]},
        {"target_direction_deg": None},
        {"optimal_moves": 3},
        {"status": "unsolvable", "target_direction_deg": None},
    ],
)
def test_a_bad_plan_does_not(change: dict[str, Any]) -> None:
    assert fault(WORLD, BOARD, TARGET, PLAN | change) is not None


@pytest.mark.parametrize("limit", [{"max_yaw_deg": 5.0}, {"lateral_limit_m": 0.01}])
def test_a_corridor_that_the_arm_cannot_follow(limit: dict[str, float]) -> None:
    limited = World.of(LAYOUT.cells, LAYOUT.cell_m, REACH.to_dict() | limit)
    assert fault(limited, BOARD, TARGET, PLAN) is not None


def test_exhaustion_finds_the_fewest_moves() -> None:
    assert Exhaustion(WORLD).fewest_moves(BOARD, TARGET)[0] == 2
    assert Exhaustion(WORLD).fewest_moves(frozenset(range(9)) - {TARGET}, TARGET)[0] is None


def test_all_boards_of_2_x_3_against_exhaustion() -> None:
    counts = plans.judge_proofs(((2, 3),), seed=0)
    assert {count.planner for count in counts} == set(plans.PROVERS)
    assert sum(count.unsolvable for count in counts) > 0
    assert [count.first_fault for count in counts if count.invalid] == []


def test_a_wrong_proof_is_refuted() -> None:
    unsolvable = Plan(Status.UNSOLVABLE, (), None, "test", 0.0)
    assert plans._refuted(unsolvable, fewest=2) is not None
    assert plans._refuted(unsolvable, fewest=None) is None
    solved = Plan(Status.SOLVED, (), 0.0, "test", 0.0, optimal_moves=0)
    assert plans._refuted(solved, fewest=1) is not None
    assert plans._refuted(solved, fewest=0) is None


def test_a_few_plans_of_every_planner(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plans, "GRIDS", ("3x6",))
    counts = plans.judge_plans(300, seed=1)
    assert {count.planner for count in counts} == set(plans.SHARES)
    assert [count.first_fault for count in counts if count.invalid] == []
