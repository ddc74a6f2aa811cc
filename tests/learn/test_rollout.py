"""Greedy episodes: every recorded move replays, and finished rows keep what they had."""

from __future__ import annotations

import pytest
import torch

from dore.learn.rollout import greedy_rollout
from dore.planners.base import RawPlan, checked_plans
from dore.world.plan import Status
from dore.world.problem import Batch
from dore.world.rules import Failure
from tests.drawings import wide_hand
from tests.worlds import make_agent, make_env


@pytest.mark.parametrize("kind", ["sequential", "single"])
def test_recorded_moves_replay_and_solved_is_true(kind):
    reach = wide_hand(3, 6)
    batch = make_env(reach, 1, 9).source.draw(300)
    rollout = greedy_rollout(make_agent(kind, False, reach, slots=9).greedy, reach, batch, max_moves=6)
    raw_plans = [
        RawPlan(rollout.moves(row), Status.SOLVED if solved else Status.GAVE_UP, 0.0)
        for row, solved in enumerate(rollout.solved.tolist())
    ]
    checked_plans(reach, batch, raw_plans, "rollout")
    assert rollout.solved.any()
    assert (~rollout.solved).any()
    assert (rollout.n_moves[rollout.solved] >= 1).all()
    assert (rollout.failure[rollout.solved] == Failure.NONE).all()


def test_rows_one_by_one_play_as_the_batch():
    reach = wide_hand(4, 4)
    choose = make_agent("sequential", False, reach).greedy
    batch = make_env(reach, 1, 6).source.draw(40)
    together = greedy_rollout(choose, reach, batch, max_moves=5)
    for row in range(40):
        alone = greedy_rollout(choose, reach, Batch(batch.board[row, None], batch.target[row, None]), max_moves=5)
        assert alone.moves(0) == together.moves(row)
        assert bool(alone.solved[0]) == bool(together.solved[row])


def test_an_accessible_target_takes_no_move():
    reach = wide_hand(3, 6)
    rollout = greedy_rollout(
        make_agent("sequential", False, reach).greedy,
        reach,
        Batch(torch.zeros(1, 1, dtype=torch.int64), torch.tensor([4])),
        max_moves=5,
    )
    assert bool(rollout.solved[0])
    assert rollout.moves(0) == []
