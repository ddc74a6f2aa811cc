"""Boards as words agree with boards as lists of cells, on one word and on two."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from dore.world import board as boards

SIZES = [1, 18, 63, 64, 65, 100, 128, 130]


@pytest.mark.parametrize("n_cells", SIZES)
def test_pack_and_unpack_are_inverse(n_cells: int) -> None:
    occupied = torch.rand(50, n_cells, generator=torch.Generator().manual_seed(n_cells)) < 0.5
    occupied[0], occupied[1] = False, True
    packed = boards.pack(occupied)
    assert packed.dtype is torch.int64
    assert packed.shape == (50, boards.n_words(n_cells))
    assert torch.equal(boards.unpack(packed, n_cells), occupied)
    assert torch.equal(boards.count(packed), occupied.sum(-1))
    nested = occupied.view(5, 10, n_cells)
    assert torch.equal(boards.unpack(boards.pack(nested), n_cells), nested)


@pytest.mark.parametrize("n_cells", SIZES)
def test_single_cells(n_cells: int) -> None:
    cell = torch.arange(n_cells)
    one = boards.bit(cell, boards.n_words(n_cells))
    assert torch.equal(boards.unpack(one, n_cells), torch.eye(n_cells, dtype=torch.bool))
    assert bool(boards.contains(one, cell).all())
    if n_cells > 1:
        assert not bool(boards.contains(one, cell.roll(1)).any())


@settings(deadline=None, max_examples=60)
@given(st.sets(st.integers(0, 99)), st.sets(st.integers(0, 99)), st.integers(0, 99))
def test_words_are_sets(mine: set[int], theirs: set[int], cell: int) -> None:
    def packed(cells: set[int]) -> torch.Tensor:
        return boards.pack(torch.tensor([[c in cells for c in range(100)]]))

    def cells(board: torch.Tensor) -> set[int]:
        return set(boards.unpack(board, 100)[0].nonzero().squeeze(-1).tolist())

    a, b = packed(mine), packed(theirs)
    assert cells(a & b) == mine & theirs
    assert cells(a & ~b) == mine - theirs
    assert bool(boards.same(a, b)) == (mine == theirs)
    assert bool(boards.contains(a, torch.tensor([cell]))) == (cell in mine)


def test_state_is_the_papers_vector() -> None:
    """The example of the paper's section 5.1: 5 by 5, obstacles on 4, 7 and 14, the target on 18."""
    occupied = torch.zeros(1, 25, dtype=torch.bool)
    occupied[0, [3, 6, 13]] = True
    state = boards.state(boards.pack(occupied), torch.tensor([17]), 25)
    assert state.tolist() == [[{3: 1.0, 6: 1.0, 13: 1.0, 17: 2.0}.get(cell, 0.0) for cell in range(25)]]
