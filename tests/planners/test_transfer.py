"""Transfer learning: what the model cannot solve a copy learns, and the model stays as it was."""

from __future__ import annotations

import pytest
import torch

from dore.errors import InputError
from dore.learn import keys
from dore.learn.trainer import MAIN
from dore.planners.base import LOCKED
from dore.planners.exact import Exact
from dore.planners.instance_memory import InstanceMemory, Returning
from dore.planners.learned import Learned
from dore.planners.transfer import Transfer
from dore.world.generator import Difficulty, FreshInstances
from dore.world.instances import InstanceSet
from dore.world.plan import Status
from dore.world.problem import Batch, Problem
from dore.world.reach import Reach
from dore.world.rules import retrievable
from tests.commands import TINY, run
from tests.drawings import WIDE_HAND, scene_of, wide_hand

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
    less = ["instances.max_obstacles=4", "network.widths=[64]", "training.max_episodes=30", "ipt.every_episodes=1000"]
    assert run("train", [*TINY, "layout.cols=4", *less, f"run_dir={folder}"]) == 0
    return folder


@pytest.fixture(scope="module")
def failed(model):
    """A few instances that the model fails on, all of which can be solved."""
    reach = wide_hand(3, 4)
    batch = FreshInstances(reach, Difficulty(3, 4), "test", 1).draw(60)
    plans = Learned(reach, model, 8).plan(batch)
    optimum = Exact(reach, 1_000_000, 60.0, 512.0).plan(batch)
    can_be = [one.status is Status.SOLVED for one in optimum]
    rows = [row for row, plan in enumerate(plans) if plan.status is not Status.SOLVED and can_be[row]][:3]
    assert rows, "the model must fail somewhere, or this shows nothing"
    return type(batch)(batch.board[rows], batch.target[rows])


def test_a_copy_learns_and_the_model_stays(model, failed):
    planner = Transfer(wide_hand(3, 4), model, **KEYS)
    before = {name: weight.clone() for name, weight in planner.base.agent.networks.state_dict().items()}
    seed = torch.get_rng_state()
    plans = planner.plan(failed)
    for plan in plans:
        assert plan.status is Status.SOLVED
        assert "episodes" in plan.reason
        assert plan.expansions > 0
    after = planner.base.agent.networks.state_dict()
    assert all(torch.equal(before[name], after[name]) for name in before)
    assert torch.equal(seed, torch.get_rng_state()), "no one else's random numbers are touched"


def test_the_same_again(model, failed):
    one = type(failed)(failed.board[:1], failed.target[:1])
    first, second = (Transfer(wide_hand(3, 4), model, **KEYS).plan(one) for _ in range(2))
    assert [plan.moves for plan in first] == [plan.moves for plan in second]
    assert [plan.reason for plan in first] == [plan.reason for plan in second]


def test_a_spent_budget_gives_up(model, failed):
    (plan, *_) = Transfer(wide_hand(3, 4), model, **(KEYS | {"max_seconds": 1e-6})).plan(failed)
    assert plan.status is Status.GAVE_UP


def test_what_is_locked_is_refused_at_once():
    scene = scene_of("""
        T . . . .
        . . . . .
        o . . . .
    """)
    reach = Reach(scene.layout, **WIDE_HAND, max_yaw_deg=5.0)
    (plan,) = Transfer(reach, None, **KEYS).plan(Batch.of(Problem(scene, reach)))
    assert (plan.status, plan.reason, plan.moves) == (Status.UNSOLVABLE, LOCKED, ())
    assert plan.planning_s < 5


@pytest.mark.parametrize(
    "drawing",
    [
        "o T o / o o o / o o o",
        "o o o o / o T o o / o o . o",
        ". o o T / o o o o / o o o o",
    ],
)
def test_what_is_exhausted_is_proved_unsolvable(drawing):
    scene = scene_of(drawing.replace("/", "\n"))
    reach = Reach(scene.layout, **WIDE_HAND)
    batch = Batch.of(Problem(scene, reach))
    (proved,) = Exact(reach, 1_000_000, 60.0, 512.0).plan(batch)
    assert proved.status is Status.UNSOLVABLE
    (plan,) = Transfer(reach, None, **KEYS).plan(batch)
    assert (plan.status, plan.reason) == (proved.status, proved.reason)


@pytest.mark.parametrize(
    "change", [{"max_seconds": 0}, {"max_episodes": 0}, {"lr": -1.0}, {"epsilon": 2.0}, {"seed": -1}]
)
def test_bad_keys(model, change):
    with pytest.raises(InputError, match="got"):
        Transfer(wide_hand(3, 4), model, **(KEYS | change))


def test_the_memory_pieces_a_way_together(failed):
    reach = wide_hand(3, 4)
    instance = InstanceSet(reach, failed.board[:1], failed.target[:1])
    memory = InstanceMemory(instance)
    (start,) = memory.boards
    planner = Transfer(reach, None, **KEYS)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        trainer = planner._trainer(planner.base.copy_of_agent(), memory)
        trainer.worlds[MAIN].player.reset()
        while memory.way is None:
            assert not memory.exhausted()
            memory.extend(trainer.worlds[MAIN].player.play(trainer.epsilon(0)).rows)
    way = memory[memory.way]
    boards = [tuple(words) for words in way[keys.BOARD].tolist()]
    following = [tuple(words) for words in way["next", keys.BOARD].tolist()]
    assert boards[0] == start
    assert following[:-1] == boards[1:]
    opened = retrievable(reach, way["next", keys.BOARD], instance.target.expand(len(boards)))
    assert opened.tolist() == [False] * (len(boards) - 1) + [True]
    known = set(memory.boards)
    assert len(known) == len(memory.boards)
    drawn = Returning(memory, seed=0).draw(200)
    assert {tuple(words) for words in drawn.board.tolist()} <= known
    assert len(drawn.board.unique(dim=0)) > 1
    assert not bool(retrievable(reach, *drawn).any())
    assert len(memory.sample(32)) == 32


@pytest.mark.parametrize("key", ["max_moves", "max_episodes", "batch_size", "max_seconds", "lr"])
def test_a_bad_number_is_named_by_this_planners_key(key):
    with pytest.raises(InputError, match=f"^planners.transfer.{key}: got 0"):
        Transfer(wide_hand(3, 4), None, **(KEYS | {key: 0}))
