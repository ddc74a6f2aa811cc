"""Shortened plans still solve, by an independent replay, and none of their moves can be left out."""

from __future__ import annotations

import pytest

from dore.planners.base import RawPlan, checked_plans
from dore.planners.beam_search import BeamSearch
from dore.planners.learned import Backtracking, Refined
from dore.planners.shorten import shortened
from dore.planners.simple import Random
from dore.world.generator import Difficulty
from dore.world.instances import InstanceSet
from dore.world.plan import PlanError, Status
from tests.drawings import wide_hand

REACH = wide_hand(3, 6)
INSTANCES = InstanceSet.generate(REACH, 200, Difficulty(6, 9), "validation", seed=0)


@pytest.fixture(scope="module")
def wandering():
    """Plans of random moves, most of them needless."""
    return Random(REACH, max_moves=24, max_nodes=2000, max_seconds=1e6, seed=0).raw_plans(INSTANCES.batch())


def solves(row: int, moves: list[tuple[int, int]]) -> bool:
    start = INSTANCES.batch(slice(row, row + 1))
    try:
        checked_plans(REACH, start, [RawPlan(moves, Status.SOLVED, 0.0)], "mine")
    except PlanError:
        return False
    return True


def test_no_move_of_a_shortened_plan_can_be_left_out(wandering):
    shorter = shortened(REACH, INSTANCES.batch(), wandering)
    solved = [row for row, plan in enumerate(wandering) if plan.status is Status.SOLVED]
    assert len(solved) > 100
    for row in solved:
        moves = list(shorter[row].moves)
        assert len(moves) <= len(wandering[row].moves)
        assert solves(row, moves)
        assert not any(solves(row, moves[:at] + moves[at + 1 :]) for at in range(len(moves)))
        for first, (pick, place) in enumerate(moves):
            for second in range(first + 1, len(moves)):
                if moves[second][0] == place:  # The same obstacle again: once is not enough.
                    once = (pick, moves[second][1])
                    rest = moves[first + 1 : second], moves[second + 1 :]
                    assert once[0] != once[1] or not solves(row, [*moves[:first], *rest[0], *rest[1]])
                    assert not solves(row, [*moves[:first], once, *rest[0], *rest[1]])
                    assert not solves(row, [*moves[:first], *rest[0], once, *rest[1]])
                    break
    before, after = (sum(len(plans[row].moves) for row in solved) for plans in (wandering, shorter))
    assert after < before / 2
    assert all(shorter[row] == plan for row, plan in enumerate(wandering) if plan.status is not Status.SOLVED)


def refined(monkeypatch, shorten):
    monkeypatch.setattr("dore.planners.learned.shortened", shorten)
    return Refined(REACH, None, max_moves=24)


def beam(monkeypatch, shorten):
    monkeypatch.setattr("dore.planners.beam_search.shortened", shorten)
    return BeamSearch(REACH, None, "random", 1.0, 2, 2, 2, max_nodes=400, max_seconds=1e6, seed=0)


@pytest.mark.parametrize("make", [refined, beam])
def test_their_plans_are_shortened(make, monkeypatch):
    batch = INSTANCES.batch()
    plans = make(monkeypatch, shortened).raw_plans(batch)
    assert [plan.moves for plan in shortened(REACH, batch, plans)] == [plan.moves for plan in plans]
    longer = make(monkeypatch, lambda reach, batch, plans: list(plans)).raw_plans(batch)
    assert sum(len(plan.moves) for plan in longer) > sum(len(plan.moves) for plan in plans)


def test_a_refined_plan_is_no_longer_and_solves_no_less():
    batch = INSTANCES.batch()
    plain, better = (kind(REACH, None, max_moves=24).plan(batch) for kind in (Backtracking, Refined))
    for one, other in zip(plain, better, strict=True):
        assert one.status is not Status.SOLVED or other.status is Status.SOLVED
        assert one.status is not Status.SOLVED or len(other.moves) <= len(one.moves)
    assert sum(len(plan.moves) for plan in better) < sum(len(plan.moves) for plan in plain)


def test_one_move_is_enough_where_one_is():
    """Whatever the network says."""
    batch = INSTANCES.batch()
    short = [row for row, plan in enumerate(Refined(REACH, None, max_moves=24).plan(batch)) if len(plan.moves) == 1]
    assert len(short) > 20
    planner = Refined(REACH, None, max_moves=24)
    for weight in planner.agent.networks.parameters():
        weight.data.zero_()
    plans = planner.plan(batch)
    assert all(len(plans[row].moves) == 1 for row in short)
