"""Lower bounds on the moves to a target, corridor by corridor; `Exact` prunes with them.

N denotes boards, D the different corridors of a cell, W the words of a board, G the cells.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from dore.world import board as boards
from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.rules import retrievable
from tests.oracles.visited_set import distinct

MAX_SPARE = 4
"""Corridors with more moves to spare are assumed to be open, untested: they nearly always are."""
MAX_WAYS = 32768
"""Where a test finds more ways than this, what is still untested is assumed to be open."""


class _Ways(NamedTuple):
    """Ways to free a corridor that are being tried, M of them."""

    case: Tensor
    """Int64[M]: which corridor of which board."""
    board: Tensor
    wanted: Tensor
    """Int64[M, W]: what still has to be moved."""
    spare: Tensor
    """Int64[M]: how many more may be wanted."""


class DeleteRelaxation:
    """Rearranging in which a moved obstacle vanishes (the delete relaxation; Hoffmann and Nebel, 2001).

    A vanished obstacle blocks nothing, and one more never closes a corridor: whatever a plan of m moves opens, its
    obstacles open by vanishing in the order of their first moves. So the fewest vanishings that make the target
    accessible, h+, are an admissible bound. It is consistent too, since a move and the vanishings after it are
    vanishings that are possible before it. Each corridor of the target has its own bound; h+ is the least of them.
    """

    def __init__(self, reach: Reach) -> None:
        self.reach = reach
        self.sets = reach.blocking_sets.transpose(0, 1).contiguous()

    def corridors_of(self, target: Tensor) -> Tensor:
        """Int64[N, D, W]: the sets of cells that must be empty for a corridor to Int64[N] targets to be free."""
        return self.sets[target]

    def locked(self, board: Tensor, target: Tensor) -> Tensor:
        """Bool[N]: no plan opens the target, because what blocks it can never be reached.

        The converse does not hold: room may be lacking.
        """
        return ~retrievable(self.reach, self._peeled(board, target, board), target)

    def open_corridors(self, board: Tensor, target: Tensor, corridors: Tensor, blocking: Tensor, budget: int) -> Tensor:
        """Which corridors of the target may be cleared within `budget` moves; False is a proof that this one may not.

        All k obstacles on a corridor must be moved, which leaves budget - k to spare. Accessible ones vanish until no
        wanted one is accessible. The next wanted one to go then needs one of its own corridors: the obstacles on it are
        wanted too, and count against what is to spare. All such choices are tried. A corridor with another wanted
        obstacle or the target on it is not a choice: that obstacle would not be the next.

        Args:
            board: Int64[N, W]; target: Int64[N]; corridors: `corridors_of(target)`.
            blocking: Int64[N, D]: k of each corridor.

        Returns:
            Bool[N, D].
        """
        is_open = blocking < budget - MAX_SPARE
        row, corridor = ((blocking <= budget) & ~is_open).nonzero(as_tuple=True)
        case = torch.arange(len(row), device=row.device)
        ways = _Ways(case, board[row], board[row] & corridors[row, corridor], budget - blocking[row, corridor])
        while len(ways.case):
            left = self._peeled(ways.board, target[row[ways.case]], ways.wanted)
            wanted = ways.wanted & left
            freed = ways.case[(wanted == 0).all(-1)]
            is_open[row[freed], corridor[freed]] = True
            untried = (ways.spare > 0) & ~is_open[row[ways.case], corridor[ways.case]]
            ways = _Ways(*(field[untried] for field in (ways.case, left, wanted, ways.spare)))
            if len(ways.case) > MAX_WAYS:
                is_open[row[ways.case], corridor[ways.case]] = True
                break
            ways = self._branches(ways, target[row[ways.case]])
        return is_open

    def _branches(self, ways: _Ways, target: Tensor) -> _Ways:
        """For each wanted obstacle and each of its corridors, the way that clears that corridor first."""
        way, cell = boards.unpack(ways.wanted, self.reach.n_cells).nonzero(as_tuple=True)
        sets = self.sets[cell]
        others = ways.wanted | boards.bit(target, ways.board.shape[-1])
        blockers = sets & ways.board[way, None]
        cost = boards.count(blockers)
        possible = (cost <= ways.spare[way, None]) & ((sets & others[way, None]) == 0).all(-1)
        at, corridor = possible.nonzero(as_tuple=True)
        way = way[at]
        wanted = ways.wanted[way] | blockers[at, corridor]
        order, first = distinct(torch.cat([wanted, ways.board[way]], -1), ways.case[way])
        kept = order[first]
        way = way[kept]
        return _Ways(ways.case[way], ways.board[way], wanted[kept], ways.spare[way] - cost[at, corridor][kept])

    def _peeled(self, board: Tensor, target: Tensor, among: Tensor) -> Tensor:
        """Int64[N, W]: the boards left when accessible obstacles of `among` vanish until none is accessible."""
        target_bit = boards.bit(target, board.shape[-1])
        while bool((among != 0).any()):
            gone = boards.pack(self.reach.accessible_packed(board | target_bit)) & among
            if not bool((gone != 0).any()):
                break
            board = board & ~gone
            among = among & ~gone
        return board


def fewest_blocking(reach: Reach, start: Batch) -> Tensor:
    """Int64[N]: obstacles on the target's best corridor; each must be moved, so no plan is shorter."""
    return boards.count(start.board & reach.blocking_sets[:, start.target]).amin(0)
