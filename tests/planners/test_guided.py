"""Exact search with a beam in between: complete, within its budget, and better where exact search does not end."""

from __future__ import annotations

import time

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from dore.errors import InputError
from dore.learn.checkpoint import SHIPPED
from dore.planners.beam import Beam, Shape
from dore.planners.exact import Exact
from dore.planners.guided import Guided
from dore.planners.priors import CostPrior, RandomPrior
from dore.world.generator import Difficulty, FreshInstances
from dore.world.instances import InstanceSet, problems_of
from dore.world.plan import Status, replay
from dore.world.problem import Batch, Problem
from dore.world.reach import Reach
from tests.drawings import scene_of, wide_hand
from tests.planners.test_exact import batch_of

KEYS = {
    "values": "network",
    "temperature": 1.0,
    "width": 8,
    "picks": 3,
    "places": 4,
    "exact_seconds": 0.1,
    "improve": False,
    "max_nodes": 1_000_000,
    "max_seconds": 60.0,
    "max_memory_mb": 512.0,
    "seed": 0,
}
AT_ONCE = 1e-9
"""CPU seconds in which exact search decides next to nothing."""


def guided(reach: Reach, model=None, **keys) -> Guided:
    return Guided(reach, model, **(KEYS | keys))


def exact(reach: Reach, batch: Batch):
    return Exact(reach, 1_000_000, 60.0, 512.0).plan(batch)


@pytest.mark.parametrize("values", ["network", "costs", "random"])
def test_complete_whatever_leads(values):
    """The dense boards of 3 x 4: each is solved, or proved to have no solution, though the beam has the first turn."""
    reach = wide_hand(3, 4)
    batch = FreshInstances(reach, Difficulty(4, 9), "validation", 0).draw(60)
    best = exact(reach, batch)
    assert {plan.status for plan in best} == {Status.SOLVED, Status.UNSOLVABLE}
    plans = guided(reach, values=values, exact_seconds=AT_ONCE, max_seconds=5.0).plan(batch)
    assert [plan.status for plan in plans] == [plan.status for plan in best]
    assert all(plan.optimal_moves in (None, len(proved.moves)) for plan, proved in zip(plans, best, strict=True))
    improved = guided(reach, values=values, exact_seconds=AT_ONCE, improve=True).plan(batch)
    assert [plan.optimal_moves for plan in improved] == [plan.optimal_moves for plan in best]


def test_exact_search_answers_first():
    """Boards that kept the search of version 0.1 busy for up to a minute; the last one's optimum is 6."""
    reach = wide_hand(8, 8)
    instances = InstanceSet.generate(reach, 976, Difficulty(3, 13), "test", 2)
    batch = instances.batch(torch.tensor([113, 180, 623, 975]))
    plans = guided(reach, max_seconds=1.0).plan(batch)
    assert [plan.optimal_moves for plan in plans] == [len(plan.moves) for plan in plans]
    assert len(plans[2].moves) == 6


def test_near_the_optimum_where_the_beam_answers():
    reach = wide_hand(6, 6)
    batch = FreshInstances(reach, Difficulty(3, 12), "validation", 7).draw(60)
    best, plans = exact(reach, batch), guided(reach, exact_seconds=AT_ONCE).plan(batch)
    solved = [(len(plan.moves), len(proved.moves)) for plan, proved in zip(plans, best, strict=True) if proved.moves]
    assert sum(ours for ours, _ in solved) <= 1.1 * sum(fewest for _, fewest in solved)


def test_plans_are_as_long_as_it_takes():
    """More than the eight moves to which the search of version 0.1 was limited at first."""
    reach = wide_hand(3, 6)
    batch = FreshInstances(reach, Difficulty(10, 10), "test", 1).draw(60)
    best, plans = exact(reach, batch), guided(reach, exact_seconds=AT_ONCE, max_seconds=5.0).plan(batch)
    long = [plan for plan, proved in zip(plans, best, strict=True) if len(proved.moves) > 8]
    assert len(long) >= 3
    assert all(plan.status is Status.SOLVED for plan in long)


def test_the_budget_of_seconds_holds():
    reach = wide_hand(8, 8)
    batch = FreshInstances(reach, Difficulty(36, 36), "test", 0).draw(8)
    planner = guided(reach, values="random", exact_seconds=AT_ONCE, max_seconds=0.05)
    began = time.thread_time()
    plans = planner.plan(batch)
    assert time.thread_time() - began < 8 * 0.05 + 0.5
    assert {plan.reason for plan in plans if plan.status is Status.GAVE_UP} <= {"time budget"}


def test_the_budget_of_boards_holds():
    reach = wide_hand(8, 8)
    batch = FreshInstances(reach, Difficulty(32, 32), "test", 0).draw(20)
    plans = guided(reach, values="random", exact_seconds=AT_ONCE, max_nodes=20).plan(batch)
    assert all(plan.expansions <= 20 + KEYS["width"] for plan in plans)
    given_up = [plan for plan in plans if plan.status is Status.GAVE_UP]
    assert given_up
    assert {plan.reason for plan in given_up} <= {"time budget", "node budget"}


def test_what_is_given_up_has_its_lower_bound():
    reach = wide_hand(8, 8)
    batch = FreshInstances(reach, Difficulty(32, 32), "test", 3).draw(20)
    plans = guided(reach, values="random", exact_seconds=AT_ONCE, max_seconds=2e-9).plan(batch)
    assert all(plan.lower_bound for plan in plans if plan.status is Status.GAVE_UP)


def test_an_accessible_target_needs_no_moves():
    scene = scene_of("T . .\n. . .")
    reach = wide_hand(2, 3)
    (plan,) = guided(reach).plan(Batch.of(Problem(scene, reach)))
    assert (plan.status, plan.moves, plan.optimal_moves, plan.expansions) == (Status.SOLVED, (), 0, 0)


def beam(reach: Reach, prior, batch: Batch, width: int):
    n = len(batch.target)
    return Beam(reach, prior, batch, Shape(width, 3, 4), [10_000] * n, [20.0] * n).run()


def test_the_beam_of_a_batch_is_that_of_its_rows():
    reach = wide_hand(6, 6)
    batch = FreshInstances(reach, Difficulty(6, 14), "validation", 1).draw(20)
    together = beam(reach, CostPrior(reach), batch, 8)
    for row, one in enumerate(together):
        (alone,) = beam(reach, CostPrior(reach), Batch(batch.board[row, None], batch.target[row, None]), 8)
        assert (one.moves, one.expansions) == (alone.moves, alone.expansions)


def test_costs_lead_better_than_nothing():
    reach = wide_hand(6, 6)
    batch = FreshInstances(reach, Difficulty(6, 12), "validation", 1).draw(40)
    led, blind = (beam(reach, prior, batch, 8) for prior in (CostPrior(reach), RandomPrior(reach, 0)))
    assert sum(one.expansions for one in led) < 0.8 * sum(one.expansions for one in blind)


@pytest.mark.parametrize("key", list(KEYS))
def test_bad_keys_are_one_line(key):
    with pytest.raises(InputError, match=rf"^planners\.guided\.{key}: got [^\n]*$"):
        guided(wide_hand(3, 3), **{key: -1})


def test_the_shipped_model_is_small():
    assert SHIPPED.stat().st_size < 5_000_000


@settings(max_examples=40, deadline=None)
@given(st.data())
def test_any_scene_gives_a_valid_plan_or_an_honest_refusal(data):
    rows, cols = data.draw(st.sampled_from([(1, 1), (1, 5), (5, 1), (3, 6), (4, 4)]))
    target, *obstacles = data.draw(st.lists(st.integers(0, rows * cols - 1), min_size=1, unique=True))
    reach = wide_hand(rows, cols)
    batch = batch_of(reach, [(frozenset(obstacles), target)])
    (plan,) = guided(reach, exact_seconds=AT_ONCE, max_nodes=3000, max_seconds=2.0).plan(batch)
    (problem,) = problems_of(reach, batch)
    replay(problem, plan)
    assert (plan.reason == "") == (plan.status is Status.SOLVED)
