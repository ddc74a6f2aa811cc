"""The greedy policy that takes moves back solves what greedy does by the same moves, and more; its plans are legal."""

from __future__ import annotations

import pytest
import torch

from dore.errors import InputError
from dore.learn.rollout import greedy_rollout
from dore.planners.learned import Backtracking, Learned
from dore.world.generator import Difficulty
from dore.world.instances import InstanceSet
from dore.world.plan import Status
from dore.world.rules import Failure
from tests.drawings import wide_hand

REACH = wide_hand(3, 4)


def first_legal(episodes):
    """A policy without sense: the first legal pick, and the first legal place for it."""
    from dore.world.rules import legal_places

    pick = episodes.legal.pick.int().argmax(-1)
    places = legal_places(REACH, episodes.board, episodes.target, episodes.visited, pick)
    return pick, places.int().argmax(-1)


@pytest.fixture(scope="module")
def batch():
    return InstanceSet.generate(REACH, 300, Difficulty(6, 8), "validation", seed=0).batch()


def test_where_no_move_is_left_it_goes_on_and_otherwise_it_is_greedy(batch):
    greedy, back = (greedy_rollout(first_legal, REACH, batch, 40, backtrack) for backtrack in (False, True))
    stuck = greedy.failure == Failure.NO_LEGAL_MOVE
    assert stuck.sum() > 5
    assert (back.solved & stuck).any(), "some of those are solved by going on"
    assert torch.equal(back.solved[~stuck], greedy.solved[~stuck])
    for row in (~stuck).nonzero().squeeze(-1).tolist():
        assert back.moves(row) == greedy.moves(row)


def test_it_gives_up_as_stuck_only_where_all_boards_that_it_can_reach_are_seen(batch):
    """With enough moves it sees every board that the start leads to: it fails only where there is no plan."""
    from dore.planners.exact import Exact

    some = type(batch)(batch.board[:60], batch.target[:60])
    back = greedy_rollout(first_legal, REACH, some, 999, backtrack=True)
    plans = Exact(REACH, max_nodes=1_000_000, max_seconds=20.0, max_memory_mb=512).plan(some)
    lost = [plan.status for plan, failure in zip(plans, back.failure, strict=True) if failure == Failure.NO_LEGAL_MOVE]
    assert all(status is Status.UNSOLVABLE for status in lost)
    assert not any(int(n) for n, failure in zip(back.n_moves, back.failure, strict=True) if failure)


def test_its_plans_replay_and_solve_more(batch):
    """`plan` replays every plan that it returns; boards that were left again are not in it."""
    planners = [kind(REACH, None, max_moves=24) for kind in (Learned, Backtracking)]
    greedy, back = ([plan.status is Status.SOLVED for plan in planner.plan(batch)] for planner in planners)
    assert all(b or not a for a, b in zip(greedy, back, strict=True))
    assert sum(back) > sum(greedy)


def test_moves_that_are_taken_back_are_boards_that_were_expanded(batch):
    plans = Backtracking(REACH, None, max_moves=24).plan(batch)
    assert any(plan.expansions > len(plan.moves) for plan in plans)
    assert all(plan.expansions <= 24 for plan in plans)


def test_bad_input_names_the_planner():
    with pytest.raises(InputError, match=r"planners.backtracking.max_moves: got 0"):
        Backtracking(REACH, None, max_moves=0)
