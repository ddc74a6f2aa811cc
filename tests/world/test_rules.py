"""The masks say exactly what a move would do, for every pair of cells."""

from __future__ import annotations

import pytest
import torch

from dore.world.board import bit, pack, unpack
from dore.world.rules import (
    Failure,
    accessibility,
    has_move,
    legal_moves,
    legal_places,
    lift,
    retrievable,
    transition,
)
from tests.drawings import cells_of, grid, wide_hand
from tests.world.random_boards import REACH, G, all_pairs, history, random_boards


@pytest.mark.parametrize("dense", [False, True])
@pytest.mark.parametrize("steps", [0, 1, 3])
def test_masks_are_legal_exactly_where_a_move_is_accepted(steps: int, dense: bool) -> None:
    board, target = random_boards(150, seed=steps, dense=dense)
    board, visited = history(REACH, board, target, steps, seed=steps)
    accepted = all_pairs(REACH, board, target, visited) == 0
    moves = legal_moves(REACH, board, target, visited)
    assert torch.equal(moves.pick, accepted.any(-1))
    assert torch.equal(moves.solved, retrievable(REACH, board, target))
    for pick in range(G):
        places = legal_places(REACH, board, target, visited, torch.full_like(target, pick))
        legal = moves.pick[:, pick]
        assert torch.equal(places[legal], accepted[legal, pick])
    assert torch.equal(
        has_move(REACH, board, target), (all_pairs(REACH, board, target, board[:, None]) == 0).any(-1).any(-1)
    )


@pytest.mark.parametrize("dense", [False, True])
def test_the_place_mask_before_the_pick_is_known(dense: bool) -> None:
    board, target = random_boards(300, seed=7, dense=dense)
    board, visited = history(REACH, board, target, 1, seed=7)
    accepted = all_pairs(REACH, board, target, visited) == 0
    moves = legal_moves(REACH, board, target, visited)
    some, every = accepted.any(1), (accepted | ~moves.pick[..., None]).all(1)
    playable = moves.pick.any(-1)
    assert bool(moves.place[playable].any(-1).all())
    safe = (moves.place & ~every)[playable].any(-1).logical_not()
    # Either all the cells of a board's mask suit every pick, or they are the ones that suit some.
    assert torch.equal(moves.place[playable][~safe], some[playable][~safe])
    if not dense:
        assert float(safe.float().mean()) > 0.8


def test_dense_boards_reach_the_rare_branch() -> None:
    """Some boards' only places open up with the lift; without any, the exhaustive test above would prove little."""
    board, target = random_boards(400, seed=1, dense=True)
    standing = board | bit(target, 1)
    before = REACH.accessible_packed(standing) & ~unpack(standing, G)
    rare = accessibility(REACH, board, target).pick.any(-1) & ~before.any(-1)
    assert int(rare.sum()) > 20
    assert bool(legal_moves(REACH, board, target, board[:, None]).pick[rare].any())


def test_a_place_that_only_the_lift_opens_is_legal_and_one_behind_an_obstacle_is_not() -> None:
    drawing = """
        T . . .
        . x . .
        . p . o
    """
    board = pack(torch.tensor([[here in "po" for here in "".join(grid(drawing))]]))
    target = torch.tensor(cells_of(drawing, "T"))
    (behind,) = cells_of(drawing, "x")
    pick = torch.tensor(cells_of(drawing, "p"))
    assert not bool(REACH.accessible_packed(board | bit(target, 1))[0, behind])
    assert bool(legal_places(REACH, board, target, board[:, None], pick)[0, behind])
    far = torch.tensor(cells_of(drawing, "o"))
    outcome = transition(REACH, board, target, board[:, None], far, torch.tensor([behind]))
    assert Failure(int(outcome.failure)) is Failure.PLACE


@pytest.mark.parametrize(("rows", "cols"), [(4, 5), (9, 9)])
def test_batch_equals_rows_one_by_one(rows: int, cols: int) -> None:
    """Row b of a batch is board b alone: no row leaks into another. 9 x 9 takes two words."""
    reach = wide_hand(rows, cols)
    board, target = random_boards(24, seed=rows, reach=reach, dense=rows == 4)
    board, visited = history(reach, board, target, 1, seed=2)
    pick = accessibility(reach, board, target).pick.float().argmax(-1)
    place = accessibility(reach, lift(board, pick), target).place.float().argmax(-1)
    together = [
        *transition(reach, board, target, visited, pick, place),
        *legal_moves(reach, board, target, visited),
        legal_places(reach, board, target, visited, pick),
    ]
    for b in range(24):
        one = slice(b, b + 1)
        alone = [
            *transition(reach, board[one], target[one], visited[one], pick[one], place[one]),
            *legal_moves(reach, board[one], target[one], visited[one]),
            legal_places(reach, board[one], target[one], visited[one], pick[one]),
        ]
        for mine, theirs in zip(alone, together, strict=True):
            assert torch.equal(mine, theirs[one]), b


def test_masks_hold_on_two_words() -> None:
    reach = wide_hand(9, 9)
    board, target = random_boards(12, seed=4, reach=reach)
    board, visited = history(reach, board, target, 1, seed=4)
    accepted = all_pairs(reach, board, target, visited) == 0
    moves = legal_moves(reach, board, target, visited)
    assert bool(accepted.any())
    assert torch.equal(moves.pick, accepted.any(-1))
