"""How many moves a target is away at least, lane by lane; what `Exact` prunes with.

N denotes boards, D the different lanes of a target, W the words of a board, G the cells.
"""

from __future__ import annotations

import torch
from torch import Tensor

from dore import board as boards
from dore.reach import Reach
from dore.rules import pickable, retrievable


def target_lanes(reach: Reach) -> Tensor:
    """Int64[G, D, W]: for each cell, the sets of cells that must be empty for one of its lanes to be free.

    A set that contains another is left out: its lane is free only where the other one is. Cells with fewer than D
    sets repeat one; a cell that no lane leads to has the full board.
    """
    closed = boards.pack(torch.ones(1, reach.n_cells, dtype=torch.bool))
    kept: list[Tensor] = []
    for cell in range(reach.n_cells):
        sets = boards.unpack(reach.blockers[cell][reach.lanes[cell]].cpu(), reach.n_cells).unique(dim=0)
        contains = (sets[:, None] | ~sets[None]).all(-1).fill_diagonal_(False)
        kept.append(boards.pack(sets[~contains.any(-1)]) if len(sets) else closed)
    most = max(len(sets) for sets in kept)
    return torch.stack([torch.cat([sets, sets[-1:].repeat(most - len(sets), 1)]) for sets in kept]).to(reach.device)


def popcount(words: Tensor) -> Tensor:
    """Int64[...]: how many bits of Int64[..., W] are set, by halves (Hacker's Delight, section 5-1)."""
    x = words - ((words >> 1) & 0x5555555555555555)
    x = (x & 0x3333333333333333) + ((x >> 2) & 0x3333333333333333)
    x = (x + (x >> 4)) & 0x0F0F0F0F0F0F0F0F
    x = x + (x >> 8)
    x = x + (x >> 16)
    x = (x + (x >> 32)) & 0x7F
    return x[..., 0] if x.shape[-1] == 1 else x.sum(-1)


def peeled(reach: Reach, board: Tensor, target: Tensor, among: Tensor) -> Tensor:
    """The boards left when obstacles of `among` vanish as soon as the hand can get to them, until none can.

    This is the delete relaxation of planning (Hoffmann and Nebel, 2001): nothing that vanishes ever stands in the
    way again, and taking one more off never closes a lane, so the order does not matter.

    Args:
        board, among: Int64[N, W]; target: Int64[N].

    Returns:
        Int64[N, W].
    """
    while True:
        gone = boards.pack(pickable(reach, board, target)) & among
        if not bool(gone.any()):
            return board
        board = board & ~gone
        among = among & ~gone


def locked(reach: Reach, board: Tensor, target: Tensor) -> Tensor:
    """Bool[N]: no plan opens the target, because what blocks it can never be reached.

    Proof: let U be what `peeled` leaves of the board. Each lane to an obstacle of U meets another one of U, or the
    target. The first of U to move would need a free lane while all of U still stands: none ever moves, and U
    blocks the target. (The converse does not hold: room may be lacking.)
    """
    return ~retrievable(reach, peeled(reach, board, target, board), target)


def open_lanes(reach: Reach, board: Tensor, target: Tensor, lanes: Tensor, blocking: Tensor, budget: int) -> Tensor:
    """Which lanes of the target may be freed within `budget` moves; False is a proof that this one may not.

    A lane with k obstacles needs k moves, each of another one of them. It needs k + 1 where those k are not
    enough: with exactly k moves no other obstacle moves, so the k must go one after the other, each by a lane
    that is free once those before it are gone. Where even `peeled`, which puts them nowhere, cannot do that, no
    sequence of k moves can.

    Args:
        board: Int64[N, W]; target: Int64[N]; lanes: Int64[N, D, W] of the targets.
        blocking: Int64[N, D]: k of each lane.

    Returns:
        Bool[N, D].
    """
    is_open = blocking < budget
    row, lane = (blocking == budget).nonzero(as_tuple=True)
    if len(row):
        among = board[row] & lanes[row, lane]
        left = peeled(reach, board[row], target[row], among) & among
        is_open[row, lane] = (left == 0).all(-1)
    return is_open
