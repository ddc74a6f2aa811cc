"""Search led by Q-values: near the proved optimum with the shipped model, complete with any."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from dore.errors import InputError
from dore.learn.checkpoint import SHIPPED, save_model
from dore.planners.exact import Exact
from dore.planners.guided import Guided
from dore.planners.learned import Learned
from dore.world.generator import Difficulty, FreshInstances
from dore.world.instances import problems_of
from dore.world.plan import Status, replay
from dore.world.problem import Batch, Problem
from dore.world.reach import Reach
from tests.drawings import scene_of, wide_hand
from tests.planners.test_exact import batch_of

KEYS = {
    "width": 16,
    "max_nodes": 1_000_000,
    "max_seconds": 60.0,
    "max_moves": 8,
    "max_memory_mb": 512.0,
    "improve_seconds": 0.0,
}


def guided(reach: Reach, model=None, **keys) -> Guided:
    return Guided(reach, model, **(KEYS | keys))


def exact(reach: Reach, batch: Batch):
    return Exact(reach, 1_000_000, 60.0, 512.0).plan(batch)


@pytest.mark.parametrize(("rows", "cols", "most"), [(8, 8, 13), (3, 6, 9), (6, 6, 9), (9, 9, 16)])
def test_near_the_proved_optimum_on_layouts_small_and_large(rows, cols, most):
    reach = wide_hand(rows, cols, 0.12 if rows < 9 else 0.1)
    batch = FreshInstances(reach, Difficulty(3, most), "validation", 7).draw(80)
    best, plans = exact(reach, batch), guided(reach).plan(batch)
    for proved, plan in zip(best, plans, strict=True):
        assert plan.status is proved.status
        assert plan.optimal_moves in (None, proved.optimal_moves)
    solved = [(len(plan.moves), len(proved.moves)) for plan, proved in zip(plans, best, strict=True)]
    assert sum(ours for ours, _ in solved) <= 1.02 * sum(fewest for _, fewest in solved)


@pytest.fixture(scope="module")
def ignorant(tmp_path_factory):
    """The shipped model's networks with weights that know nothing."""
    torch.manual_seed(0)
    planner = Learned(wide_hand(3, 3), None, 8)
    weights = {name: torch.randn_like(weight) for name, weight in planner.agent.networks.state_dict().items()}
    path = tmp_path_factory.mktemp("model") / "ignorant.safetensors"
    save_model(path, weights, dict(planner._config))
    return path


def test_complete_whatever_the_weights(ignorant):
    """The dense boards of 3 x 4: each is solved, or proved to have no solution, by the narrowest beam too."""
    reach = wide_hand(3, 4)
    batch = FreshInstances(reach, Difficulty(4, 9), "validation", 0).draw(150)
    best, plans = exact(reach, batch), guided(reach, ignorant, width=1, max_moves=2).plan(batch)
    assert {plan.status for plan in best} == {Status.SOLVED, Status.UNSOLVABLE}
    assert [plan.status for plan in plans] == [plan.status for plan in best]


def test_improves_until_it_is_proved_or_out_of_time(ignorant):
    reach = wide_hand(4, 4)
    batch = FreshInstances(reach, Difficulty(5, 9), "validation", 0).draw(60)
    best = exact(reach, batch)
    first = guided(reach, ignorant, width=1).plan(batch)
    plans = guided(reach, ignorant, width=1, improve_seconds=20.0).plan(batch)
    assert [plan.optimal_moves for plan in plans] == [plan.optimal_moves for plan in best]
    assert sum(len(plan.moves) for plan in first) > sum(len(plan.moves) for plan in plans)


def test_a_batch_is_its_rows_one_by_one():
    reach = wide_hand(6, 6)
    batch = FreshInstances(reach, Difficulty(3, 9), "validation", 1).draw(70)
    together = guided(reach).plan(batch)
    alone = [guided(reach).plan(Batch(batch.board[row, None], batch.target[row, None]))[0] for row in range(70)]
    assert [(plan.status, len(plan.moves)) for plan in together] == [(plan.status, len(plan.moves)) for plan in alone]


def test_an_accessible_target_needs_no_moves():
    scene = scene_of("T . .\n. . .")
    reach = wide_hand(2, 3)
    (plan,) = guided(reach).plan(Batch.of(Problem(scene, reach)))
    assert (plan.status, plan.moves, plan.optimal_moves, plan.expansions) == (Status.SOLVED, (), 0, 0)


@pytest.mark.parametrize(
    ("budget", "reason"), [({"max_nodes": 3}, "node budget"), ({"max_seconds": 1e-6}, "time budget")]
)
def test_a_tiny_budget_gives_up(ignorant, budget, reason):
    reach = wide_hand(6, 6)
    batch = FreshInstances(reach, Difficulty(9, 9), "validation", 0).draw(20)
    plans = guided(reach, ignorant, width=1, max_moves=2, **budget).plan(batch)
    given_up = [plan for plan in plans if plan.status is Status.GAVE_UP]
    assert given_up
    assert {plan.reason for plan in given_up} == {reason}


def test_little_memory_gives_up(ignorant):
    reach = wide_hand(6, 6)
    batch = FreshInstances(reach, Difficulty(9, 9), "validation", 0).draw(8)
    plans = guided(reach, ignorant, width=64, max_memory_mb=0.01).plan(batch)
    assert all(plan.status in (Status.SOLVED, Status.GAVE_UP) for plan in plans)
    assert {plan.reason for plan in plans if plan.status is Status.GAVE_UP} == {"memory budget"}


@pytest.mark.parametrize("key", list(KEYS))
def test_bad_keys_are_one_line(key):
    with pytest.raises(InputError, match=rf"^planners\.guided\.{key}: got [^\n]*$"):
        guided(wide_hand(3, 3), **{key: -1})


def test_the_shipped_model_is_small():
    assert SHIPPED.stat().st_size < 5_000_000


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_any_scene_gives_a_valid_plan_or_an_honest_refusal(data):
    rows, cols = data.draw(st.sampled_from([(1, 1), (1, 5), (5, 1), (3, 6), (4, 4)]))
    target, *obstacles = data.draw(st.lists(st.integers(0, rows * cols - 1), min_size=1, unique=True))
    reach = wide_hand(rows, cols)
    batch = batch_of(reach, [(frozenset(obstacles), target)])
    (plan,) = guided(reach, max_nodes=3000, max_seconds=2.0).plan(batch)
    (problem,) = problems_of(reach, batch)
    replay(problem, plan)
    assert (plan.reason == "") == (plan.status is Status.SOLVED)
