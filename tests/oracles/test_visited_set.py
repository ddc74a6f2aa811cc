"""The boards that a search has seen, against a dictionary."""

from __future__ import annotations

import random

import pytest
import torch

from tests.drawings import wide_hand
from tests.oracles import visited_set as seen
from tests.oracles.visited_set import SeenBoards, SeenBoardsFull
from tests.planners.test_exact import check_against_enumeration

CPU = torch.device("cpu")


@pytest.mark.parametrize("words", [1, 2])
def test_keeps_each_board_once_with_the_fewest_moves(words: int) -> None:
    generator = torch.Generator().manual_seed(words)
    kept, known = SeenBoards(words, 10, CPU), {}
    for moves in (5, 4, 4, 6, 3, 5):
        board = torch.randint(-3, 4, (200, words), generator=generator)
        row = torch.randint(4, (200,), generator=generator)
        parent = torch.full_like(row, kept.size - 1)
        places = kept.add(board, row, parent, torch.full_like(row, moves))
        wanted = {(r, *b) for r, b in zip(row.tolist(), board.tolist(), strict=True)}
        better = {key for key in wanted if moves < known.get(key, 99)}
        got = [(r, *b) for r, b in zip(kept.row[places].tolist(), kept.board[places].tolist(), strict=True)]
        assert sorted(got) == sorted(better)
        known.update({key: moves for key in better})
        here = slice(kept.size)
        keys = [(r, *b) for r, b in zip(kept.row[here].tolist(), kept.board[here].tolist(), strict=True)]
        assert dict(zip(keys, kept.moves[here].tolist(), strict=True)) == known
        assert len(keys) == len(known)


def test_a_board_reached_by_fewer_moves_starts_over() -> None:
    kept = SeenBoards(1, 1, CPU)
    one = torch.tensor([0])
    kept.add(torch.tensor([[3]]), one, one - 1, one)
    kept.add(torch.tensor([[5]]), one, one, one + 4)
    kept.done[1] = 2
    assert kept.add(torch.tensor([[5]]), one, one, one + 4).tolist() == []
    assert kept.add(torch.tensor([[5]]), one, one, one + 1).tolist() == [1]
    assert (int(kept.moves[1]), int(kept.done[1])) == (1, 0)
    assert kept.moves_to(torch.tensor([1, 0, -1])) == [[(1, 2)], [], []]


def test_what_does_not_fit_is_refused_and_not_kept() -> None:
    kept = SeenBoards(1, 0.001, CPU)
    board = torch.arange(kept.capacity + 1)[:, None]
    row = torch.zeros_like(board[:, 0])
    with pytest.raises(SeenBoardsFull):
        kept.add(board, row, row - 1, row)
    assert kept.size == 0
    assert len(kept.add(board[:-1], row[:-1], row[:-1] - 1, row[:-1])) == kept.capacity


@pytest.mark.parametrize("n_keys", [60, 300])
def test_boards_that_share_a_key_change_no_answer(monkeypatch: pytest.MonkeyPatch, n_keys: int) -> None:
    honest = seen._key
    monkeypatch.setattr(seen, "_key", lambda board, row: honest(board, row).remainder(n_keys))
    draw = random.Random(n_keys)
    cells = [draw.sample(range(9), draw.randint(5, 8)) for _ in range(25)]
    check_against_enumeration(wide_hand(3, 3), [(frozenset(rest), target) for target, *rest in cells])
