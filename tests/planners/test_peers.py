"""The planners to compare with: what each of them chooses, and their budgets."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from dore.errors import InputError
from dore.planners.mcts import Mcts
from dore.planners.policy import opening_places
from dore.planners.relocation_graph import RelocationGraph
from dore.planners.simple import Lookahead, Random, WinElseRandom
from dore.planners.tree import Leaf, Tree, number_of, words_of
from dore.world.board import bit
from dore.world.generator import Difficulty
from dore.world.instances import InstanceSet
from dore.world.plan import Status
from dore.world.problem import Batch, Problem
from dore.world.reach import Reach
from dore.world.rules import retrievable
from tests.drawings import cells_of, scene_of, wide_hand

REACH = wide_hand(4, 5)
SET = InstanceSet.generate(REACH, 60, Difficulty(5, 9), "test", seed=3)
TRY = {"max_moves": 16, "max_nodes": 16, "max_seconds": 60.0}
UNIFORM = {"priors": "uniform", "model": None, "c_puct": 1.0, "temperature": 0.1, "gamma": 0.8}


def solved(planner: Random | Lookahead | RelocationGraph | Mcts) -> int:
    return sum(plan.status is Status.SOLVED for plan in planner.plan(SET.batch()))


def test_each_knows_more_than_the_one_before() -> None:
    counts = [solved(Random(REACH, **TRY, seed=0)), solved(WinElseRandom(REACH, **TRY, seed=0))]
    counts.append(solved(Lookahead(REACH, 16)))
    assert counts == sorted(set(counts))


def test_chances_are_the_instances_own_and_the_seeds() -> None:
    plans = [plan.moves for plan in Random(REACH, **TRY, seed=0).plan(SET.batch())]
    again = [Random(REACH, **TRY, seed=0).plan(SET.batch(slice(n, n + 1)))[0].moves for n in range(5)]
    assert again == plans[:5]
    assert plans != [plan.moves for plan in Random(REACH, **TRY, seed=1).plan(SET.batch())]
    picks = torch.tensor([moves[0].place for moves in plans if moves])
    assert len(picks.unique()) > 8, "not the same place again and again"


def test_random_tries_again_within_its_budget() -> None:
    for most in (16, 100):
        plans = Random(REACH, 16, most, 60.0, seed=0).plan(SET.batch())
        assert max(plan.expansions for plan in plans) <= most
    more = solved(Random(REACH, 16, 400, 60.0, seed=0))
    assert more > solved(Random(REACH, **TRY, seed=0))
    assert solved(Random(REACH, 16, 400, 1e-9, seed=0)) < more, "CPU seconds end it"


def test_winning_moves_are_those_after_which_the_target_is_accessible() -> None:
    board, target = SET.board, SET.target
    opens = opening_places(REACH, board, target)
    for cell in range(REACH.n_cells):
        after = board | bit(torch.full_like(target, cell), board.shape[-1])
        assert torch.equal(opens[:, cell], retrievable(REACH, after, target))


def test_the_relocation_graph_clears_the_path_from_the_front() -> None:
    scene = scene_of(
        """
        . . T . .
        . . b . .
        . . a . .
        . . . . .
        """.replace("a", "o").replace("b", "o")
    )
    near, far = scene.obstacles
    reach = wide_hand(4, 5)
    (plan,) = RelocationGraph(reach, 16).plan(Batch.of(Problem(scene, reach)))
    assert plan.status is Status.SOLVED
    assert [move.pick for move in plan.moves] == [near, far]
    assert len(cells_of(". . T . .", "T")) == 1


def test_mcts_finds_plans_within_its_nodes_and_proves_that_there_is_none() -> None:
    found = Mcts(REACH, **UNIFORM, max_nodes=200, max_seconds=60.0).plan(SET.batch())
    few = Mcts(REACH, **UNIFORM, max_nodes=2, max_seconds=60.0).plan(SET.batch())
    assert sum(plan.status is Status.SOLVED for plan in found) > sum(plan.status is Status.SOLVED for plan in few)
    assert max(plan.expansions for plan in found) <= 200
    assert {plan.reason for plan in few if plan.status is Status.GAVE_UP} == {"node budget"}
    full = Reach(wide_hand(3, 3).layout, 0.142, 15.0, 30)
    board = torch.tensor([[0b111111110 & ~(1 << 7) | 1]])
    (none,) = Mcts(full, **UNIFORM, max_nodes=50, max_seconds=60.0).plan(Batch(board, torch.tensor([7])))
    assert none.status is Status.UNSOLVABLE


def test_a_tree_goes_where_the_values_are() -> None:
    tree = Tree(0b1, {0b1})
    tree.grow(0b1, Leaf(np.array([[0, 1], [0, 2]]), np.array([0.5, 0.5], np.float32), 0.5, None), 0.8)
    assert tree.select(1.0) == 0b10
    tree.grow(0b10, Leaf(np.array([[1, 2]]), np.array([1.0], np.float32), 0.9, None), 0.8)
    assert tree.root is not None
    assert tree.root.totals.tolist() == pytest.approx([0.72, 0.0])
    assert tree.select(0.0) == 0b100, "of the better board, its only move"


def test_boards_as_numbers() -> None:
    for words in ([5], [-1], [3, -(1 << 63)]):
        assert words_of(number_of(words), len(words)) == words


def test_bad_priors() -> None:
    with pytest.raises(InputError, match=r"planners.mcts.priors: got 'none', want one of network, uniform"):
        Mcts(REACH, **{**UNIFORM, "priors": "none"}, max_nodes=1, max_seconds=1.0)  # type: ignore[arg-type]
