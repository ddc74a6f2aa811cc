"""Transfer learning: what the model cannot solve a copy learns, and the model stays as it was."""

from __future__ import annotations

import pytest
import torch

from dore.errors import InputError
from dore.plan import Status
from dore.planners.learned import Learned
from dore.planners.transfer import Transfer
from dore.sampling import Difficulty, FreshInstances
from tests.commands import TINY, run
from tests.drawings import wide_hand

KEYS = {
    "max_moves": 8,
    "max_episodes": 3000,
    "max_seconds": 20.0,
    "epsilon": 0.3,
    "lr": 1e-3,
    "batch_size": 32,
    "seed": 0,
}


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """A model that has hardly learned."""
    folder = tmp_path_factory.mktemp("model") / "run"
    less = ["instances.max_obstacles=4", "training.max_episodes=30", "ipt.every_episodes=1000"]
    assert run("train", [*TINY, "layout.cols=4", *less, f"run_dir={folder}"]) == 0
    return folder


@pytest.fixture(scope="module")
def failed(model):
    """A few instances that the model fails on, all of which can be solved."""
    reach = wide_hand(3, 4)
    batch = FreshInstances(reach, Difficulty(3, 4), "test", 1).draw(60)
    plans = Learned(reach, model, 8).plan(batch)
    rows = [row for row, plan in enumerate(plans) if plan.status is not Status.SOLVED][:3]
    assert rows, "the model must fail somewhere, or this shows nothing"
    return type(batch)(batch.board[rows], batch.target[rows])


def test_a_copy_learns_and_the_model_stays(model, failed):
    planner = Transfer(wide_hand(3, 4), model, **KEYS)
    before = {name: weight.clone() for name, weight in planner.base.agent.networks.state_dict().items()}
    seed = torch.get_rng_state()
    plans = planner.plan(failed)
    assert any(plan.status is Status.SOLVED for plan in plans)
    for plan in plans:
        assert "episodes" in plan.reason
        assert plan.expansions > 0
    after = planner.base.agent.networks.state_dict()
    assert all(torch.equal(before[name], after[name]) for name in before)
    assert torch.equal(seed, torch.get_rng_state()), "no one else's random numbers are touched"


def test_the_same_again(model, failed):
    first, second = (Transfer(wide_hand(3, 4), model, **KEYS).plan(failed) for _ in range(2))
    assert [plan.moves for plan in first] == [plan.moves for plan in second]
    assert [plan.reason for plan in first] == [plan.reason for plan in second]


def test_a_spent_budget_gives_up(model, failed):
    (plan, *_) = Transfer(wide_hand(3, 4), model, **(KEYS | {"max_seconds": 1e-6})).plan(failed)
    assert plan.status is Status.GAVE_UP


@pytest.mark.parametrize(
    "change", [{"max_seconds": 0}, {"max_episodes": 0}, {"lr": -1.0}, {"epsilon": 2.0}, {"seed": -1}]
)
def test_bad_keys(model, change):
    with pytest.raises(InputError, match="got"):
        Transfer(wide_hand(3, 4), model, **(KEYS | change))
