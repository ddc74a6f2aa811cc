"""The rules: masks say exactly what a move would do, for every pair of cells."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from dore.world.board import bit, count, pack, same, unpack
from dore.world.reach import Reach
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

REACH = wide_hand(3, 4)
G = REACH.n_cells


def random_boards(n: int, seed: int, reach: Reach = REACH, dense: bool = False) -> tuple[Tensor, Tensor]:
    """Boards Int64[n, W] of every density (dense: at least 60 %) without their targets Int64[n]."""
    generator = torch.Generator().manual_seed(seed)
    share = torch.rand(n, 1, generator=generator)
    occupied = torch.rand(n, reach.n_cells, generator=generator) < (0.6 + 0.4 * share if dense else share)
    target = torch.randint(reach.n_cells, (n,), generator=generator)
    occupied[torch.arange(n), target] = False
    return pack(occupied), target


def history(reach: Reach, board: Tensor, target: Tensor, steps: int, seed: int) -> tuple[Tensor, Tensor]:
    """The board after some random accepted moves, and all boards so far: Int64[B, W], Int64[B, T, W]."""
    generator = torch.Generator().manual_seed(seed)
    visited = board[:, None]
    for _ in range(steps):
        pick = torch.randint(reach.n_cells, target.shape, generator=generator)
        for _ in range(20):
            place = torch.randint(reach.n_cells, target.shape, generator=generator)
            again = torch.randint(reach.n_cells, target.shape, generator=generator)
            outcome = transition(reach, board, target, visited, pick, place)
            pick = torch.where(outcome.failure == 0, pick, again)
            board = torch.where((outcome.failure == 0)[:, None], outcome.board, board)
            visited = torch.cat([visited, board[:, None]], 1)
    return board, visited


def all_pairs(reach: Reach, board: Tensor, target: Tensor, visited: Tensor) -> Tensor:
    """Int64[B, G, G]: the failure of every (pick, place)."""
    g, n = reach.n_cells, len(target)
    pick = torch.arange(g).repeat_interleave(g).repeat(n)
    place = torch.arange(g).repeat(g * n)
    row = torch.arange(n).repeat_interleave(g * g)
    return transition(reach, board[row], target[row], visited[row], pick, place).failure.view(n, g, g)


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


def brute_failure(board: set[int], target: int, visited: list[set[int]], pick: int, place: int) -> Failure:
    """Section 5.1's four failures, from `Reach.accessible` on plain sets."""

    def accessible(standing: set[int], cell: int) -> bool:
        return bool(REACH.accessible(torch.tensor([[k in standing for k in range(G)]]))[0, cell])

    lifted = board - {pick}
    pick_fails = pick not in board or not accessible(board | {target}, pick)
    place_fails = place in lifted | {target} or not accessible(lifted | {target}, place)
    if pick_fails or place_fails:
        return Failure(int(pick_fails) + 2 * int(place_fails))
    return Failure.GO_BACK if lifted | {place} in visited else Failure.NONE


cells = st.integers(0, G - 1)


@settings(deadline=None, max_examples=80)
@given(st.sets(cells, max_size=G - 1), cells, st.lists(st.sets(cells, max_size=5), max_size=4), cells, cells)
def test_failures_are_those_of_the_definition(
    board: set[int], target: int, earlier: list[set[int]], pick: int, place: int
) -> None:
    board = board - {target}
    visited = [board, *({*board} ^ change for change in earlier)]
    packed = pack(torch.tensor([[k in one for k in range(G)] for one in visited]))
    outcome = transition(
        REACH, packed[:1], torch.tensor([target]), packed[None], torch.tensor([pick]), torch.tensor([place])
    )
    expected = brute_failure(board, target, visited, pick, place)
    assert outcome.failure.item() == expected
    moved = (board - {pick}) | {place} if expected is Failure.NONE else board
    assert set(unpack(outcome.board, G)[0].nonzero().squeeze(-1).tolist()) == moved


HAND_MADE = """
    T . . b
    . . a w
    . p . .
"""


@pytest.mark.parametrize(
    ("pick", "place", "failure"),
    [
        ("p", ".", Failure.NONE),
        (".", "!", Failure.PICK),
        ("T", "!", Failure.PICK),
        ("b", "!", Failure.PICK),
        ("p", "w", Failure.PLACE),
        ("p", "T", Failure.PLACE),
        (".", "w", Failure.PICK_AND_PLACE),
        ("b", "T", Failure.PICK_AND_PLACE),
        ("p", "p", Failure.GO_BACK),
    ],
)
def test_the_four_failures_on_a_drawn_board(pick: str, place: str, failure: Failure) -> None:
    # b stands behind w; "!" is the near right corner, which is empty and open.
    drawing = HAND_MADE
    board = pack(torch.tensor([[here in "abwp" for here in "".join(grid(drawing))]]))
    target = torch.tensor(cells_of(drawing, "T"))

    def cell(mark: str) -> Tensor:
        return torch.tensor([3] if mark == "!" else cells_of(drawing, mark)[:1])

    outcome = transition(REACH, board, target, board[:, None], cell(pick), cell(place))
    assert Failure(int(outcome.failure)) is failure
    assert torch.equal(outcome.board, board) == (failure is not Failure.NONE)
    assert int(count(outcome.board)) == 4


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


def test_going_back_is_refused_to_any_earlier_board_and_no_other() -> None:
    board = bit(torch.tensor([1]), 1)
    target = torch.tensor([11])
    first = transition(REACH, board, target, board[:, None], torch.tensor([1]), torch.tensor([0]))
    visited = torch.stack([board, first.board], 1)
    second = transition(REACH, first.board, target, visited, torch.tensor([0]), torch.tensor([3]))
    visited = torch.cat([visited, second.board[:, None]], 1)
    assert (int(first.failure), int(second.failure)) == (0, 0)
    for place, failure in ((1, Failure.GO_BACK), (0, Failure.GO_BACK), (3, Failure.GO_BACK), (2, Failure.NONE)):
        last = transition(REACH, second.board, target, visited, torch.tensor([3]), torch.tensor([place]))
        assert Failure(int(last.failure)) is failure
    places = legal_places(REACH, second.board, target, visited, torch.tensor([3]))[0]
    assert places.nonzero().squeeze(-1).tolist() == [k for k in range(11) if k not in (0, 1, 3)]


def test_opened_says_whether_the_lift_alone_freed_the_target() -> None:
    board, target = random_boards(300, seed=9)
    board = board[~retrievable(REACH, board, target)]
    target = random_boards(300, seed=9)[1][~retrievable(REACH, *random_boards(300, seed=9))]
    for pick in range(G):
        cell = torch.full_like(target, pick)
        opened = transition(REACH, board, target, board[:, None], cell, cell).opened
        expected = accessibility(REACH, board, target).pick[:, pick] & retrievable(REACH, lift(board, cell), target)
        assert torch.equal(opened, expected)


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


def test_accepted_moves_keep_every_obstacle_and_never_come_back() -> None:
    board, target = random_boards(200, seed=6)
    after, visited = history(REACH, board, target, 2, seed=6)
    assert torch.equal(count(after), count(board))
    assert not bool(unpack(after, G).gather(-1, target[:, None]).any())
    moved = ~same(after, board)
    assert bool(moved.any())
    changed = ~same(visited[:, 1:], visited[:, :-1])
    for row in moved.nonzero().squeeze(-1).tolist():
        seen = [
            tuple(words) for words, new in zip(visited[row, 1:].tolist(), changed[row].tolist(), strict=True) if new
        ]
        assert len(set(seen)) == len(seen)
