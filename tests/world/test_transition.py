"""A move: the four failures, going back, what stays on the board, and what the lift opens."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from dore.world.board import bit, count, pack, same, unpack
from dore.world.rules import (
    Failure,
    accessibility,
    legal_places,
    lift,
    retrievable,
    transition,
)
from tests.drawings import cells_of, grid
from tests.world.random_boards import REACH, G, history, random_boards


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
