"""The rules of rearranging, as pure batched functions on packed boards.

B denotes the batch, G the cells, W the words of a board, T the boards an episode remembers. A row's result
depends on that row alone. `target` stands on the board wherever accessibility is checked, but is never lifted.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import torch
from torch import Tensor

from dore.world.board import bit, contains, same, unpack
from dore.world.reach import Reach


class Failure(IntEnum):
    """Why a move was refused (paper, section 5.1), or why an episode could not continue."""

    NONE = 0
    PICK = 1
    """No obstacle on the cell, or the hand cannot get to it."""
    PLACE = 2
    """The cell is not empty, or the hand cannot get to it once the obstacle is off the board."""
    PICK_AND_PLACE = 3
    """Both."""
    GO_BACK = 4
    """The next board equals an earlier board of the episode."""
    NO_LEGAL_MOVE = 5
    """The move was fine, but no move is left (not in the paper, where such an episode fails a move later)."""


class MoveResult(NamedTuple):
    """What a move did."""

    board: Tensor
    """Int64[B, W]: the next board; the old one where the move was refused."""
    failure: Tensor
    """Int64[B]: a `Failure` code."""
    opened: Tensor
    """Bool[B]: the lift alone already freed the target (the pick network's reward, section 5.2)."""


class LegalMoves(NamedTuple):
    """What may be done on a board."""

    pick: Tensor
    """Bool[B, G]: obstacles that can be picked and then placed somewhere."""
    place: Tensor
    """Bool[B, G]: cells open before the lift, and so to every legal pick; on boards without one, the cells that
    some lift opens. Means nothing on a board without a legal pick."""
    solved: Tensor
    """Bool[B]: the target is accessible."""
    pickable: Tensor
    """Bool[B, G]: m_p, eq. 11-12: obstacles that the hand can get to, placed or not."""


class Accessibility(NamedTuple):
    """What the hand can get to on a board: one check of the board gives all three."""

    pick: Tensor
    """Bool[B, G]: m_p, eq. 11-12: an obstacle stands there and the hand can get to it."""
    place: Tensor
    """Bool[B, G]: m_l, eq. 16-17, where the board's picked obstacle is off: empty and in the hand's reach."""
    target: Tensor
    """Bool[B]: the target can be retrieved."""


def accessibility(reach: Reach, board: Tensor, target: Tensor) -> Accessibility:
    """Both masks of Int64[B, W] boards, and whether their Int64[B] targets are accessible."""
    free = reach.accessible_packed(board | bit(target, board.shape[-1]))
    obstacles, cell = unpack(board, reach.n_cells), target[:, None]
    return Accessibility(
        free & obstacles, (free & ~obstacles).scatter_(-1, cell, False), free.gather(-1, cell).squeeze(-1)
    )


def retrievable(reach: Reach, board: Tensor, target: Tensor) -> Tensor:
    """Bool[B]: whether the target is accessible with every obstacle standing."""
    return reach.cell_accessible(board, target)


def lift(board: Tensor, pick: Tensor) -> Tensor:
    """Int64[B, W]: the board without the obstacle on Int64[B] cells."""
    return board & ~bit(pick, board.shape[-1])


def legal_places(reach: Reach, board: Tensor, target: Tensor, visited: Tensor, pick: Tensor) -> Tensor:
    """Bool[B, G]: where the obstacle on `pick` may go: m_l, and not back to a visited board.

    visited: Int64[B, T, W], the episode's boards, the present one included.
    """
    lifted = lift(board, pick)
    return accessibility(reach, lifted, target).place & ~going_back(lifted, visited, reach.n_cells)


def going_back(lifted: Tensor, visited: Tensor, n_cells: int) -> Tensor:
    """Bool[B, G]: cells on which the lifted obstacle would make a board that was visited before."""
    return unpack(_single_cells(visited ^ lifted[:, None]), n_cells)


def legal_moves(reach: Reach, board: Tensor, target: Tensor, visited: Tensor) -> LegalMoves:
    """Exact masks: a pick is legal when some place makes `transition` accept the pair.

    A cell that is open before the lift stays open after it, so such a cell proves every pick; only the rare
    rows without one are checked pick by pick.
    """
    pickable, open_before, solved = accessibility(reach, board, target)
    pick = pickable.clone()
    place = open_before & ~unpack(_single_cells(visited & ~board[:, None]), reach.n_cells)
    doubtful = (pick.any(-1) & ~place.any(-1)).nonzero().squeeze(-1)
    if doubtful.numel():
        row, cell = pick[doubtful].nonzero(as_tuple=True)
        source = doubtful[row]
        places = legal_places(reach, board[source], target[source], visited[source], cell)
        pick[source, cell] = places.any(-1)
        place[doubtful] = torch.zeros_like(place[doubtful]).index_put((row,), places, accumulate=True)
    return LegalMoves(pick, place, solved, pickable)


def has_move(reach: Reach, board: Tensor, target: Tensor) -> Tensor:
    """Bool[B]: whether an episode that starts on this board has a legal first move."""
    return legal_moves(reach, board, target, board[:, None]).pick.any(-1)


def transition(
    reach: Reach,
    board: Tensor,
    target: Tensor,
    visited: Tensor,
    pick: Tensor,
    place: Tensor,
    pickable: Tensor | None = None,
) -> MoveResult:
    """One pick-and-place a row; a refused move changes nothing (paper, section 5.1).

    Args:
        board: Int64[B, W]; target, pick, place: Int64[B] cells; visited: Int64[B, T, W].
        pickable: Bool[B, G], m_p of these boards where it is known; else the picked cells alone are checked.
    """
    words = board.shape[-1]
    target_bit, place_bit = bit(target, words), bit(place, words)
    if pickable is None:
        pick_ok = contains(board, pick) & reach.cell_accessible(board | target_bit, pick)
    else:
        pick_ok = pickable.gather(-1, pick[:, None]).squeeze(-1)
    lifted = lift(board, pick)
    standing = lifted | target_bit
    place_ok = ~contains(standing, place) & reach.cell_accessible(standing, place)
    moved = lifted | place_bit
    again = same(visited, moved[:, None]).any(-1)
    failure = torch.where(pick_ok, 0, int(Failure.PICK)) + torch.where(place_ok, 0, int(Failure.PLACE))
    failure = torch.where((failure == 0) & again, int(Failure.GO_BACK), failure)
    accepted = failure == 0
    opened = pick_ok & reach.cell_accessible(lifted, target)
    return MoveResult(torch.where(accepted[:, None], moved, board), failure, opened)


def _single_cells(words: Tensor) -> Tensor:
    """Int64[B, W]: the union over T of those Int64[B, T, W] boards that have exactly one cell set.

    By halves, because torch has no bitwise reduction.
    """
    power_of_two = (words != 0) & ((words & (words - 1)) == 0)
    single = power_of_two.any(-1) & ((words != 0).sum(-1) == 1)
    words = torch.where(single[..., None], words, 0)
    while words.shape[1] > 1:
        half = words.shape[1] // 2
        union = words[:, :half] | words[:, half : 2 * half]
        words = torch.cat([union, words[:, 2 * half :]], 1)
    return words[:, 0]
