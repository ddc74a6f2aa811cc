"""The bound that the exact planner prunes with never exceeds the enumerated optimum."""

from __future__ import annotations

import random

import pytest
import torch
from torch import Tensor

from dore.planners.exact import Exact
from dore.world.board import count
from dore.world.layout import Layout
from dore.world.reach import Reach
from dore.world.rules import retrievable
from tests.drawings import PUBLISHED, WIDE_HAND, scene_of, wide_hand
from tests.oracles import bounds
from tests.oracles.bounds import DeleteRelaxation
from tests.planners.test_exact import batch_of, check_against_enumeration, every_board
from tests.trust.judge import Board, Exhaustion, World


def least_budgets(reach: Reach, cases: list[tuple[Board, int]], most: int) -> tuple[Tensor, Tensor]:
    """Int64[N]: the least budget that opens a corridor, `most` where none does; and the fewest obstacles on one."""
    board, target = batch_of(reach, cases)
    relaxation = DeleteRelaxation(reach)
    corridors = relaxation.corridors_of(target)
    blocking = count(board[:, None] & corridors)
    least = torch.full_like(target, most)
    before = torch.zeros_like(blocking, dtype=torch.bool)
    for budget in range(most):
        is_open = relaxation.open_corridors(board, target, corridors, blocking, budget)
        assert bool((is_open | ~before).all()), "a corridor that opens within a budget opens within a greater one"
        least = torch.where(is_open.any(-1), least.clamp_max(budget), least)
        before = is_open
    return least, blocking.amin(-1)


@pytest.mark.parametrize(
    ("rows", "cols", "preset", "every"),
    [(2, 3, WIDE_HAND, 1), (3, 3, WIDE_HAND, 1), (3, 3, PUBLISHED, 2), (3, 4, WIDE_HAND, 40)],
)
def test_never_above_the_optimum_and_stronger_than_counting(
    rows: int, cols: int, preset: dict[str, float], every: int
) -> None:
    reach = Reach(Layout.grid(rows, cols, 0.12), **preset)  # type: ignore[arg-type]
    cases = every_board(rows * cols)[::every]
    least, counted = least_budgets(reach, cases, most=12)
    enumeration = Exhaustion(World.of_reach(reach))
    for case, bound in zip(cases, least.tolist(), strict=True):
        fewest, _ = enumeration.fewest_moves(*case)
        assert fewest is None or bound <= fewest, case
        assert (bound == 0) == (fewest == 0), case
    assert bool((least >= counted).all())
    assert bool((least > counted).any()) == (rows > 2)


def test_a_chain_of_obstacles_counts_as_a_whole() -> None:
    scene = scene_of("""
        . . . . . . . .
        . . . . . . . .
        T o o o . . . .
        . . . o . . . .
        . . . o . . . .
        . . . . . . . .
        . . . o . . . .
        . . . o . . . .
    """)
    reach = wide_hand(8, 8)
    case = (frozenset(scene.obstacles), scene.target)
    least, counted = least_budgets(reach, [case], most=12)
    (plan,) = Exact(reach, 1_000_000, 60.0, 512.0).plan(batch_of(reach, [case]))
    assert int(counted) < int(least) <= (plan.optimal_moves or 0)


def test_locked_boards_have_no_plan() -> None:
    # No corridor leads to the corners near the robot.
    reach = Reach(Layout.grid(3, 5, 0.12), **WIDE_HAND, max_yaw_deg=5.0)  # type: ignore[arg-type]
    draw = random.Random(0)
    cells = [draw.sample(range(15), draw.randint(2, 9)) for _ in range(300)]
    cases = [(frozenset(obstacles), target) for target, *obstacles in cells]
    board, target = batch_of(reach, cases)
    relaxation = DeleteRelaxation(reach)
    locked = relaxation.locked(board, target)
    assert 0 < int(locked.sum()) < len(cases)
    assert not bool((locked & retrievable(reach, board, target)).any())
    plans = Exact(reach, 1_000_000, 60.0, 512.0).plan(batch_of(reach, cases))
    assert all(plan.status == "unsolvable" for plan, shut in zip(plans, locked.tolist(), strict=True) if shut)


@pytest.mark.parametrize(("name", "value"), [("MAX_SPARE", 0), ("MAX_WAYS", 0), ("MAX_WAYS", 5), ("MAX_SPARE", 20)])
def test_how_much_is_tested_changes_no_answer(monkeypatch: pytest.MonkeyPatch, name: str, value: int) -> None:
    monkeypatch.setattr(bounds, name, value)
    draw = random.Random(value)
    cells = [draw.sample(range(16), draw.randint(8, 15)) for _ in range(60)]
    cases = [(frozenset(obstacles), target) for target, *obstacles in cells]
    check_against_enumeration(wide_hand(4, 4), cases)
