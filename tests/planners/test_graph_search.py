"""The paper's graph search, against enumeration and the proved optimum."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from dore.errors import InputError
from dore.planners.exact import Exact
from dore.planners.graph_search import GraphSearch
from dore.world.generator import Difficulty
from dore.world.instances import InstanceSet, problems_of
from dore.world.layout import Layout
from dore.world.plan import Status, replay
from dore.world.problem import Batch, Problem
from dore.world.reach import Reach
from tests.drawings import PUBLISHED, WIDE_HAND, cells_of, scene_of, wide_hand
from tests.planners.test_exact import batch_of, every_board
from tests.trust.judge import Exhaustion, World

BUDGETS = {"max_nodes": 1_000_000, "max_seconds": 60.0}


def graph_search(reach: Reach, **budgets: float) -> GraphSearch:
    return GraphSearch(reach, **{**BUDGETS, **budgets})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("rows", "cols", "preset", "every"), [(2, 3, WIDE_HAND, 1), (2, 3, PUBLISHED, 1), (3, 3, WIDE_HAND, 5)]
)
def test_every_board_of_a_small_layout(rows: int, cols: int, preset: dict[str, float], every: int) -> None:
    reach = Reach(Layout.grid(rows, cols, 0.12), **preset)  # type: ignore[arg-type]
    enumeration = Exhaustion(World.of_reach(reach))
    cases = every_board(rows * cols)[::every]
    batch = batch_of(reach, cases)
    plans = graph_search(reach).plan(batch)
    for case, problem, plan in zip(cases, problems_of(reach, batch), plans, strict=True):
        fewest, boards_seen = enumeration.fewest_moves(*case)
        assert plan.optimal_moves == fewest, case
        assert plan.status is (Status.UNSOLVABLE if fewest is None else Status.SOLVED)
        assert plan.reason in ("", f"all {boards_seen} boards that can be reached are exhausted")
        assert len(replay(problem, plan)) == (fewest or 0) + 1


@pytest.mark.parametrize(
    ("rows", "cols", "least", "most", "n"), [(3, 6, 3, 7, 60), (4, 4, 3, 10, 60), (10, 10, 8, 10, 8)]
)
def test_agrees_with_the_proved_optimum(rows: int, cols: int, least: int, most: int, n: int) -> None:
    reach = wide_hand(rows, cols)
    instances = InstanceSet.generate(reach, n, Difficulty(least, most), "test", seed=4)
    plans = graph_search(reach, max_nodes=5000).plan(instances.batch())
    proved = Exact(reach, 1_000_000, 60.0, 512.0).plan(instances.batch())
    decided = 0
    for problem, plan, best in zip(instances, plans, proved, strict=True):
        replay(problem, plan)
        if plan.status is not Status.GAVE_UP:
            assert (plan.status, len(plan.moves)) == (best.status, len(best.moves))
            decided += 1
    assert decided > 0.7 * n


def test_branches_on_the_pick_and_then_on_the_place() -> None:
    drawing = """
        . T .
        . o .
        . . .
    """
    scene = scene_of(drawing)
    reach = wide_hand(3, 3)
    (plan,) = graph_search(reach).plan(Batch.of(Problem(scene, reach)))
    (move,) = plan.moves
    assert move.pick == cells_of(drawing, "o")[0]
    assert plan.expansions == 1


def test_an_accessible_target_needs_no_moves() -> None:
    scene = scene_of("T . .\n. . .")
    reach = wide_hand(2, 3)
    (plan,) = graph_search(reach, max_nodes=1).plan(Batch.of(Problem(scene, reach)))
    assert (plan.status, plan.moves, plan.optimal_moves, plan.expansions) == (Status.SOLVED, (), 0, 0)


@pytest.mark.parametrize(
    ("budget", "reason"), [({"max_nodes": 10}, "node budget"), ({"max_seconds": 1e-9}, "time budget")]
)
def test_a_tiny_budget_gives_up(budget: dict[str, float], reason: str) -> None:
    reach = wide_hand(6, 6)
    instances = InstanceSet.generate(reach, 20, Difficulty(9, 9), "test", seed=0)
    given_up = [plan for plan in graph_search(reach, **budget).plan(instances.batch()) if plan.reason]
    assert len(given_up) > 5
    assert all((plan.status, plan.reason, plan.moves) == (Status.GAVE_UP, reason, ()) for plan in given_up)


@pytest.mark.parametrize("key", ["max_nodes", "max_seconds"])
@pytest.mark.parametrize("value", [0, -1, "many"])
def test_bad_budgets_are_one_line(key: str, value: float) -> None:
    with pytest.raises(InputError, match=rf"^planners\.graph_search\.{key}: got [^\n]*$"):
        graph_search(wide_hand(3, 3), **{key: value})


def test_the_config_holds_the_constructors_keys() -> None:
    config = yaml.safe_load((Path(__file__).parents[2] / "conf/planner/graph_search.yaml").read_text())
    assert config.pop("_target_") == "dore.planners.graph_search.GraphSearch"
    graph_search(wide_hand(3, 3), **config)
    assert config.keys() == BUDGETS.keys()


def test_no_instances_no_plans() -> None:
    empty = Batch(torch.empty(0, 1, dtype=torch.int64), torch.empty(0, dtype=torch.int64))
    assert len(graph_search(wide_hand(3, 3)).plan(empty)) == 0


@settings(max_examples=100, deadline=None)
@given(st.data())
def test_any_scene_gives_a_valid_plan_or_an_honest_refusal(data: st.DataObject) -> None:
    rows, cols = data.draw(st.sampled_from([(1, 1), (1, 5), (5, 1), (3, 6), (4, 4)]))
    target, *obstacles = data.draw(st.lists(st.integers(0, rows * cols - 1), min_size=1, unique=True))
    reach = wide_hand(rows, cols)
    batch = batch_of(reach, [(frozenset(obstacles), target)])
    (plan,) = graph_search(reach, max_nodes=300).plan(batch)
    (problem,) = problems_of(reach, batch)
    replay(problem, plan)
    assert (plan.status is Status.SOLVED) == (plan.optimal_moves is not None) == (plan.reason == "")
