"""The paper's baseline, and the check that every planner's plans go through."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
import yaml

from dore.errors import InputError
from dore.planners.base import RawPlan, checked_plans
from dore.planners.straight_line import GiveUp, StraightLine
from dore.world.generator import Difficulty
from dore.world.instances import InstanceSet
from dore.world.layout import Layout
from dore.world.plan import PlanError, Status, replay
from dore.world.problem import Batch, Problem, Scene
from dore.world.reach import Reach
from dore.world.rules import retrievable
from tests.drawings import PUBLISHED, WIDE_HAND, cells_of, scene_of, wide_hand

DEFAULTS = {"start_x_m": 0.0, "start_y_m": 0.0, "corridor_m": None, "avoid_corridors": False, "max_moves": 30}


def baseline(reach: Reach, **keys: object) -> StraightLine:
    return StraightLine(reach, **{**DEFAULTS, **keys})  # type: ignore[arg-type]


def moves_of(drawing: str, reach: dict[str, float], **keys: object) -> list[tuple[int, int]]:
    """What the baseline does on a drawing that it solves."""
    scene = scene_of(drawing)
    there = Reach(scene.layout, **reach)  # type: ignore[arg-type]
    (plan,) = baseline(there, **keys).plan(Batch.of(Problem(scene, there)))
    assert plan.status is Status.SOLVED
    assert plan.reason == ""
    return [(move.pick, move.place) for move in plan.moves]


def test_removes_the_obstacle_in_the_way_to_the_cell_farthest_from_the_target() -> None:
    drawing = """
        . . T . .
        . . . . .
        . . o . .
        a . . . .
    """
    assert moves_of(drawing, WIDE_HAND) == [(cells_of(drawing, "o")[0], cells_of(drawing, "a")[0])]


def test_an_accessible_target_needs_no_moves_though_its_corridor_holds_something() -> None:
    drawing = """
        . . T . .
        . . . . .
        . . . o .
    """
    assert moves_of(drawing, WIDE_HAND, corridor_m=0.3) == []


def test_everything_in_the_corridor_goes_nearest_first_though_less_would_do() -> None:
    drawing = """
        . . T . .
        . . . . .
        . . o . .
        . . . . .
        . . . o .
        . . . . .
    """
    wide = moves_of(drawing, WIDE_HAND, corridor_m=0.13)
    near, far = cells_of(drawing, "o")
    assert [pick for pick, _ in wide] == [near, far]
    assert [pick for pick, _ in moves_of(drawing, WIDE_HAND, corridor_m=0.05)] == [far]


def test_an_obstacle_out_of_reach_has_its_own_way_cleared_first() -> None:
    drawing = """
        . . T . .
        . . . . .
        . . o . .
        . . . . .
        . o . o .
        . . . . .
    """
    left, right, far = cells_of(drawing, "o")
    planner = baseline(wide_hand(6, 5), corridor_m=0.05)
    assert {left, right, far}.intersection(planner.corridors[cells_of(drawing, "T")[0]]) == {far}
    first, second = (pick for pick, _ in moves_of(drawing, WIDE_HAND, corridor_m=0.05))
    assert first in {left, right}
    assert second == far


def test_an_approach_is_cleared_where_the_corridor_holds_nothing() -> None:
    drawing = """
        . o T . .
        . . . o .
        . . . . .
    """
    planner = baseline(wide_hand(3, 5), corridor_m=0.01)
    assert set(cells_of(drawing, "o")).isdisjoint(planner.corridors[cells_of(drawing, "T")[0]])
    assert moves_of(drawing, WIDE_HAND, corridor_m=0.01) != []


def test_avoiding_corridors_puts_nothing_where_it_is_cleared_again() -> None:
    reach = wide_hand(6, 6)
    instances = InstanceSet.generate(reach, 100, Difficulty(7, 9), "test", seed=0)
    counts = {}
    for avoid in (False, True):
        plans = baseline(reach, avoid_corridors=avoid).plan(instances.batch())
        counts[avoid] = [len(plan.moves) if plan.status is Status.SOLVED else None for plan in plans]
    both = [(a, b) for a, b in zip(counts[False], counts[True], strict=True) if a is not None and b is not None]
    assert sum(b for _, b in both) < 0.9 * sum(a for a, _ in both)


def test_gives_up_by_name() -> None:
    reach = wide_hand(3, 6)
    instances = InstanceSet.generate(reach, 300, Difficulty(7, 11), "test", seed=0)
    plans = baseline(reach, max_moves=3).plan(instances.batch())
    assert {plan.reason.split(":")[0] for plan in plans} == {"", *GiveUp}
    assert all(plan.target_direction_deg is None for plan in plans if plan.reason)


@pytest.mark.parametrize("avoid", [False, True])
@pytest.mark.parametrize(("rows", "cols", "most"), [(3, 6, 9), (6, 6, 14), (10, 10, 30)])
def test_plans_replay_and_end_with_a_clear_corridor_or_stuck(rows: int, cols: int, most: int, avoid: bool) -> None:
    reach = wide_hand(rows, cols)
    instances = InstanceSet.generate(reach, 60, Difficulty(3, most), "test", seed=rows)
    planner = baseline(reach, avoid_corridors=avoid)
    solved = 0
    for problem, plan in zip(instances, planner.plan(instances.batch()), strict=True):
        boards = replay(problem, plan)
        assert len(plan.moves) <= 30
        assert (plan.status is Status.SOLVED) == (plan.reason == "")
        if plan.status is Status.SOLVED:
            solved += boards[-1].isdisjoint(planner.corridors[problem.scene.target])
        else:
            alone = Batch.of(Problem(Scene(reach.layout, tuple(boards[-1]), problem.scene.target), reach))
            assert not retrievable(reach, *alone)
    assert solved > 20


def test_batch_equals_rows_one_by_one() -> None:
    reach = wide_hand(5, 5)
    instances = InstanceSet.generate(reach, 40, Difficulty(3, 8), "train", seed=1)
    planner = baseline(reach)
    together = planner.plan(instances.batch())
    for row, plan in enumerate(together):
        (alone,) = planner.plan(instances.batch(slice(row, row + 1)))
        assert (alone.moves, alone.status, alone.reason) == (plan.moves, plan.status, plan.reason)


@pytest.mark.parametrize(
    ("keys", "named"),
    [
        ({"start_x_m": 0.6}, "start_x_m"),
        ({"start_x_m": float("nan")}, "start_x_m"),
        ({"corridor_m": 0.0}, "corridor_m"),
        ({"avoid_corridors": "no"}, "avoid_corridors"),
        ({"max_moves": -1}, "max_moves"),
    ],
)
def test_bad_values_are_one_line(keys: dict[str, object], named: str) -> None:
    with pytest.raises(InputError, match=f"^planners.straight_line.{named}: [^\n]*$"):
        baseline(wide_hand(3, 6), **keys)


def test_the_config_holds_the_constructors_keys_and_the_defaults_tested_here() -> None:
    path = Path(__file__).parents[2] / "conf/planner/straight_line.yaml"
    config = yaml.safe_load(path.read_text())
    assert config.pop("_target_") == "dore.planners.straight_line.StraightLine"
    assert config == DEFAULTS


BLOCKED = """
    . T .
    . o .
    . . .
    . . .
"""


@pytest.mark.parametrize(
    ("moves", "status", "why"),
    [
        ([], Status.SOLVED, "target: no free approach direction"),
        ([(3, 0)], Status.GAVE_UP, r"move 1 \(4 to 1\): no obstacle on cell 4"),
        ([(7, 7)], Status.GAVE_UP, r"move 1 \(8 to 8\): goes back"),
        ([(7, 0), (0, 10)], Status.GAVE_UP, r"move 2 \(1 to 11\): cell 11 is not empty"),
        ([(7, 0), (0, 12)], Status.GAVE_UP, r"move 2 \(1 to 13\): place id 13, want 1 to 12"),
        ([(-1, 0)], Status.GAVE_UP, r"move 1 \(0 to 1\): no obstacle on cell 0"),
    ],
)
def test_a_raw_plan_that_breaks_a_rule_is_refused_by_name(
    moves: list[tuple[int, int]], status: Status, why: str
) -> None:
    scene = scene_of(BLOCKED)
    reach = Reach(scene.layout, **PUBLISHED)  # type: ignore[arg-type]
    one = Batch.of(Problem(scene, reach))
    batch = Batch(torch.cat([one.board, one.board]), torch.cat([one.target, one.target]))
    good = RawPlan([(7, 0)], Status.SOLVED, 0.0)
    with pytest.raises(PlanError, match=f"instance 2: {why}"):
        checked_plans(reach, batch, [good, RawPlan(moves, status, 0.0)], "some planner")


def test_directions_are_those_of_reach() -> None:
    scene = scene_of(BLOCKED)
    reach = Reach(scene.layout, **PUBLISHED)  # type: ignore[arg-type]
    raw_plan = RawPlan([(7, 1)], Status.GAVE_UP, 0.5, expansions=3, reason="why")
    (plan,) = checked_plans(reach, Batch.of(Problem(scene, reach)), [raw_plan], "p")
    lifted = Batch.of(Problem(Scene(scene.layout, (10,), 0), reach)).board
    (move,) = plan.moves
    assert move.pick_direction_deg == reach.direction_deg(lifted, torch.tensor([7])).item()
    assert move.place_direction_deg == reach.direction_deg(lifted, torch.tensor([1])).item()
    assert (plan.planner, plan.planning_s, plan.expansions, plan.reason) == ("p", 0.5, 3, "why")


def test_no_instances_no_plans() -> None:
    reach = Reach(Layout.grid(2, 2, 0.12), **PUBLISHED)  # type: ignore[arg-type]
    empty = Batch(torch.empty(0, 1, dtype=torch.int64), torch.empty(0, dtype=torch.int64))
    assert baseline(reach).plan(empty) == []
