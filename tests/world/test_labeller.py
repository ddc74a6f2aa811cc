"""Exact labels, against breadth-first search of every board after every legal move."""

import pytest
import torch

from dore.errors import InputError
from dore.planners.graph_search import GraphSearch
from dore.world.board import bit
from dore.world.by_optimum import OptimumSplits
from dore.world.generator import SPLITS, Difficulty, FreshInstances, split_share
from dore.world.instances import InstanceSet
from dore.world.labeller import ILLEGAL, NO_PLAN, UNDECIDED, Labeller
from dore.world.layout import Layout
from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.rules import legal_places, lift

HARD = Reach(Layout.grid(3, 4, 0.12, None), clearance_m=0.19, half_fan_deg=20.0, n_sectors=40)


def fewest(reach: Reach, batch: Batch) -> list[int]:
    plans = GraphSearch(reach, max_nodes=10**6, max_seconds=60.0).raw_plans(batch)
    return [NO_PLAN if plan.optimal_moves is None else plan.optimal_moves for plan in plans]


def boards(reach: Reach, n: int, least: int, most: int) -> Batch:
    return FreshInstances(reach, Difficulty(least, most), "train", 3).draw(n)


def test_labels_are_those_of_breadth_first_search():
    batch = boards(HARD, 60, 3, 7)
    labels = Labeller(HARD, 10**6, 60).label(batch)
    expected = fewest(HARD, batch)
    assert labels.fewest.tolist() == expected
    assert NO_PLAN in expected
    assert max(expected) > 4
    for row, optimum in enumerate(expected):
        board, target = batch.board[row : row + 1], batch.target[row : row + 1]
        for pick in range(HARD.n_cells):
            cell = torch.tensor([pick])
            stands = bool((board & bit(cell, 1)).any()) and bool(HARD.cell_accessible(board | bit(target, 1), cell))
            legal = legal_places(HARD, board, target, board[:, None], cell)[0] & stands & (optimum > 0)
            wasted = labels.wasted[row, pick]
            assert (wasted != ILLEGAL).tolist() == legal.tolist()
            places = legal.nonzero().squeeze(-1)
            after = lift(board, cell) | bit(places, 1)
            left = fewest(HARD, Batch(after, target.expand(len(places))))
            assert wasted[places].tolist() == [moves + 1 - optimum for moves in left]


def test_what_is_given_up_has_no_label_and_the_rest_is_as_it_was():
    batch = boards(HARD, 40, 5, 7)
    known, hurried = Labeller(HARD, 10**6, 60).label(batch), Labeller(HARD, 3, 60).label(batch)
    decided = hurried.fewest != UNDECIDED
    assert 0 < int(decided.sum()) < 40
    assert torch.equal(hurried.fewest[decided], known.fewest[decided])
    labelled = hurried.wasted >= 0
    assert bool(labelled.any())
    assert torch.equal(hurried.wasted[labelled], known.wasted[labelled])
    short = Labeller(HARD, 10**6, 2).fewest(batch)
    assert torch.equal(short > 0, (known.fewest > 0) & (known.fewest <= 2))


def test_enough_ends_the_labels_after_whole_boards():
    batch = boards(HARD, 40, 5, 7)
    labeller = Labeller(HARD, 10**6, 60)
    whole, part = labeller.label(batch), labeller.label(batch, enough=200)
    done = int((part.fewest != UNDECIDED).sum())
    assert 0 < done < 40
    assert torch.equal(part.wasted[:done], whole.wasted[:done])
    assert bool((part.wasted[done:] == ILLEGAL).all())
    assert bool((part.fewest[done:] == UNDECIDED).all())


def splits(**changed) -> OptimumSplits:
    given = {
        **{"min_density": 0.3, "max_density": 0.5, "keep": [0.0, 0.0, 1.0], "max_nodes": 3000, "max_moves": 20},
        **{"validation_size": 30, "test_size": 30, "seed": 0},
    }
    return OptimumSplits(**{**given, **changed})


def test_chosen_instances_have_the_density_and_the_moves_asked_for():
    source = splits().train(HARD, 5)
    batch = source.draw(50)
    density = torch.tensor([bin(board).count("1") for board in batch.board[:, 0].tolist()]) / HARD.n_cells
    assert bool((density > 0.25).all())
    assert bool((density <= 0.5).all())
    assert min(fewest(HARD, batch)) == 3
    share = split_share(batch.board, HARD)
    assert bool((share < SPLITS["train"][1]).all())


def test_a_source_continues_from_its_state():
    source = splits(keep=[0.5]).train(HARD, 5)
    source.draw(10)
    state = source.state_dict()
    expected = source.draw(40)
    other = splits(keep=[0.5]).train(HARD, 6)
    other.load_state_dict(state)
    assert all(torch.equal(a, b) for a, b in zip(other.draw(40), expected, strict=True))


def test_the_sets_are_of_their_split_and_always_the_same():
    test = splits().test(HARD)
    assert isinstance(test, InstanceSet)
    assert len(test) == 30
    assert bool((split_share(test.board, HARD) >= SPLITS["test"][0]).all())
    assert torch.equal(test.board, splits().test(HARD).board)


@pytest.mark.parametrize(
    ("changed", "line"),
    [
        ({"keep": []}, "instances.keep: got [], want a list of chances, for 1, 2, ... moves"),
        ({"keep": [0.0]}, "instances.keep: got [0.0], want one above 0"),
        ({"keep": [2.0]}, "instances.keep: got 2.0, want a finite number"),
        ({"min_density": 0.6}, "instances.min_density: 0.6 is above max_density 0.5"),
        ({"max_moves": 0}, "instances.max_moves: got 0"),
    ],
)
def test_numbers_outside_their_domain_are_refused(changed, line):
    with pytest.raises(InputError) as caught:
        splits(**changed).train(HARD, 0)
    assert str(caught.value).startswith(line)


def test_instances_that_do_not_exist_are_refused():
    with pytest.raises(InputError, match=r"has a length that instances\.keep keeps"):
        splits(min_density=0.1, max_density=0.1, keep=[0.0] * 6 + [1.0]).train(HARD, 0).draw(1)
