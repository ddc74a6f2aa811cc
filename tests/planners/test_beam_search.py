"""The beam as a planner of its own: without exact search, within its budget."""

from __future__ import annotations

import torch

from dore.planners.beam_search import BeamSearch
from dore.world.generator import Difficulty, FreshInstances
from dore.world.labeller import Labeller
from dore.world.plan import Status
from dore.world.problem import Batch
from tests.drawings import wide_hand

KEYS = {
    "model": None,
    "values": "costs",
    "temperature": 1.0,
    "width": 8,
    "picks": 3,
    "places": 4,
    "max_nodes": 2000,
    "max_seconds": 60.0,
    "seed": 0,
}


def plans_of(**changes):
    reach = wide_hand(6, 6)
    batch = FreshInstances(reach, Difficulty(10, 14), "validation", 1).draw(30)
    return BeamSearch(reach, **{**KEYS, **changes}).plan(batch)  # type: ignore[arg-type]


def test_it_solves_without_a_proof():
    solved = [plan for plan in plans_of() if plan.status is Status.SOLVED]
    assert len(solved) > 20
    assert {plan.optimal_moves for plan in solved} <= {None, 0}


def test_a_wider_beam_solves_more():
    solved = [sum(plan.status is Status.SOLVED for plan in plans_of(values="random", width=w)) for w in (1, 16)]
    assert solved[0] < solved[1]


def test_what_is_given_up_says_why():
    given_up = [plan for plan in plans_of(values="random", max_nodes=10) if plan.status is Status.GAVE_UP]
    assert {plan.reason for plan in given_up} >= {"node budget"}
    assert all(plan.expansions <= 10 + KEYS["width"] for plan in given_up)


def test_an_accessible_target_needs_no_move():
    reach = wide_hand(6, 6)
    blocked = FreshInstances(reach, Difficulty(10, 14), "validation", 1).draw(1)
    batch = Batch(torch.cat([torch.zeros_like(blocked.board), blocked.board]), blocked.target.repeat(2))
    first, second = BeamSearch(reach, **KEYS).plan(batch)  # type: ignore[arg-type]
    assert (first.status, first.moves, first.expansions) == (Status.SOLVED, (), 0)
    assert len(second.moves) > 0


def test_a_winning_move_is_made_however_improbable():
    reach = wide_hand(6, 6)
    batch = FreshInstances(reach, Difficulty(4, 8), "validation", 1).draw(60)
    one_move = [row for row, n in enumerate(Labeller(reach, 10_000, 20).fewest(batch).tolist()) if n == 1]
    assert len(one_move) > 10
    plans = BeamSearch(reach, **{**KEYS, "values": "random", "width": 1, "picks": 1, "places": 1}).plan(batch)  # type: ignore[arg-type]
    assert all(len(plans[row].moves) == 1 for row in one_move)
