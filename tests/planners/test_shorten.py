"""Shortened plans still solve, by an independent replay, and no change of theirs makes them shorter."""

from __future__ import annotations

import pytest
from torch import Tensor

from dore.planners.base import RawPlan, checked_plans
from dore.planners.beam_search import BeamSearch
from dore.planners.learned import Backtracking
from dore.planners.refined import Refined
from dore.planners.shorten import shortened
from dore.planners.simple import Random
from dore.world.episode import Episodes
from dore.world.generator import Difficulty
from dore.world.instances import InstanceSet
from dore.world.mirror import mirrored_board, mirrored_cell
from dore.world.plan import PlanError, Status
from dore.world.problem import Batch
from dore.world.rules import legal_places
from tests.drawings import wide_hand

REACH = wide_hand(3, 6)
INSTANCES = InstanceSet.generate(REACH, 200, Difficulty(6, 9), "validation", seed=0)


@pytest.fixture(scope="module")
def wandering():
    """Plans of random moves, most of them needless."""
    return Random(REACH, max_moves=24, max_nodes=400, max_seconds=1e6, seed=0).raw_plans(INSTANCES.batch())


def solves(row: int, moves: list[tuple[int, int]]) -> bool:
    start = INSTANCES.batch(slice(row, row + 1))
    try:
        checked_plans(REACH, start, [RawPlan(moves, Status.SOLVED, 0.0)], "mine")
    except PlanError:
        return False
    return True


def fewer(moves: list[tuple[int, int]]):
    """A move less; of an obstacle that is moved twice, both less or one less."""
    for first, (pick, place) in enumerate(moves):
        before, after = moves[:first], moves[first + 1 :]
        second = next((at for at, (cell, _) in enumerate(after) if cell == place), None)
        if second is None:
            yield before + after
        else:
            between, end, rest = after[:second], after[second][1], after[second + 1 :]
            yield from ([*before, *between, *rest], [*before, (pick, end), *between, *rest])
            yield [*before, *between, (pick, end), *rest]


def elsewhere(moves: list[tuple[int, int]]):
    """One obstacle is put on another cell."""
    for first, (pick, place) in enumerate(moves):
        second = next((at for at in range(first + 1, len(moves)) if moves[at][0] == place), None)
        for cell in range(REACH.n_cells):
            other = list(moves)
            other[first] = (pick, cell)
            if second is not None:
                other[second] = (cell, moves[second][1])
            yield other


@pytest.fixture(scope="module")
def shorter(wandering):
    return shortened(REACH, INSTANCES.batch(), wandering)


def test_no_move_of_a_shortened_plan_can_be_left_out(wandering, shorter):
    solved = [row for row, plan in enumerate(wandering) if plan.status is Status.SOLVED]
    assert len(solved) > 100
    for row in solved:
        moves = list(shorter[row].moves)
        assert len(moves) <= len(wandering[row].moves)
        assert solves(row, moves)
        assert not any(solves(row, other) for other in fewer(moves))
    before, after = (sum(len(plans[row].moves) for row in solved) for plans in (wandering, shorter))
    assert after < before / 2
    assert all(shorter[row] == plan for row, plan in enumerate(wandering) if plan.status is not Status.SOLVED)


def test_no_move_can_be_left_out_by_putting_another_obstacle_elsewhere(shorter):
    long = [row for row, plan in enumerate(shorter) if 2 < len(plan.moves) < 6][:4]
    assert len(long) == 4
    for row in long:
        for one in fewer(list(shorter[row].moves)):
            assert not any(solves(row, other) for other in elsewhere(one))


def test_nor_by_putting_two_others_elsewhere(shorter):
    for row in [row for row, plan in enumerate(shorter) if len(plan.moves) == 3][:3]:
        for one in fewer(list(shorter[row].moves)):
            both = {tuple(two) for other in elsewhere(one) for two in elsewhere(other)}
            assert not any(solves(row, list(other)) for other in both)


def refined(monkeypatch, shorten):
    monkeypatch.setattr("dore.planners.refined.shortened", shorten)
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


def cost(plan: RawPlan) -> int:
    return len(plan.moves) if plan.status is Status.SOLVED else 99


def leftmost(self, episodes: Episodes) -> tuple[Tensor, Tensor]:
    """The legal move of the lowest cells, so that the plans of a board and of its mirror image differ."""
    pick = episodes.legal.pick.long().argmax(-1)
    return pick, legal_places(REACH, episodes.board, episodes.target, episodes.visited, pick).long().argmax(-1)


def test_the_better_of_the_plans_of_a_board_and_of_its_mirror_image(monkeypatch):
    batch = INSTANCES.batch()
    image = Batch(mirrored_board(batch.board, REACH), mirrored_cell(batch.target, REACH))
    monkeypatch.setattr(Refined, "choose", leftmost)
    both = Refined(REACH, None, max_moves=24).raw_plans(batch)
    monkeypatch.setattr(REACH, "mirror", None)
    alone, mirrored = (Refined(REACH, None, max_moves=24).raw_plans(one) for one in (batch, image))
    lengths = [[cost(plan) for plan in plans] for plans in (alone, mirrored)]
    assert any(one < other for one, other in zip(*lengths, strict=True))
    assert any(one > other for one, other in zip(*lengths, strict=True))
    assert [cost(plan) for plan in both] == list(map(min, *lengths))
    spent = [one.expansions + other.expansions for one, other in zip(alone, mirrored, strict=True)]
    assert [plan.expansions for plan in both] == spent
