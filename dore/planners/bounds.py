"""How many moves a target is away at least, lane by lane; what `Exact` prunes with.

N denotes boards, D the different lanes of a cell, W the words of a board, G the cells.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from dore.planners.visited_set import distinct
from dore.world import board as boards
from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.rules import retrievable

MAX_SPARE = 4
"""Lanes with more moves to spare are taken for open, untested: they nearly always are."""
MAX_WAYS = 32768
"""Where more ways than this turn up in a test, what is still untested is taken for open."""

LOCKED = "1 board seen: what blocks the target can never be reached"
"""The reason of a plan that `DeleteRelaxation.locked` refuses."""


class _Ways(NamedTuple):
    """Ways to free a lane that are being tried, M of them."""

    case: Tensor
    """Int64[M]: which lane of which board."""
    board: Tensor
    wanted: Tensor
    """Int64[M, W]: what has to go yet."""
    spare: Tensor
    """Int64[M]: how many more may be wanted."""


class DeleteRelaxation:
    """Rearranging with moved obstacles vanishing (the delete relaxation; Hoffmann and Nebel, 2001).

    Nothing that has vanished stands in the way, and one vanishing more never closes a lane: whatever a plan of m
    moves opens, the obstacles it moves open by vanishing, in the order of their first moves. So the fewest vanishings
    that free the target, h+, are an admissible bound; it is consistent too, since a move and what has to vanish
    after it make up what may vanish before it. Each lane of the target is bounded by itself: h+ is their least.
    """

    def __init__(self, reach: Reach) -> None:
        self.reach = reach
        self.sets = reach.blocking_sets.transpose(0, 1).contiguous()
        self.bits = boards.cell_bits(reach.n_cells, reach.device).unbind(-1)

    def lanes_of(self, target: Tensor) -> Tensor:
        """Int64[N, D, W]: the sets of cells that must be empty for a lane to Int64[N] targets to be free."""
        return self.sets[target]

    def locked(self, board: Tensor, target: Tensor) -> Tensor:
        """Bool[N]: no plan opens the target, because what blocks it can never be reached.

        The converse does not hold: room may be lacking.
        """
        return ~retrievable(self.reach, self._peeled(board, target, board), target)

    def open_lanes(self, board: Tensor, target: Tensor, lanes: Tensor, blocking: Tensor, budget: int) -> Tensor:
        """Which lanes of the target may be freed within `budget` moves; False is a proof that this one may not.

        All k obstacles on a lane have to go, which leaves budget - k to spare. Those that the hand gets to vanish,
        until none of the wanted ones can. The first of these that goes then does so by one of its lanes: what stands
        there is wanted too, and is taken from what is to spare. All such choices are tried. A lane that another
        wanted obstacle or the target stands on is none: that obstacle would not be the first.

        Args:
            board: Int64[N, W]; target: Int64[N]; lanes: `lanes_of(target)`.
            blocking: Int64[N, D]: k of each lane.

        Returns:
            Bool[N, D].
        """
        is_open = blocking < budget - MAX_SPARE
        row, lane = ((blocking <= budget) & ~is_open).nonzero(as_tuple=True)
        case = torch.arange(len(row), device=row.device)
        ways = _Ways(case, board[row], board[row] & lanes[row, lane], budget - blocking[row, lane])
        while len(ways.case):
            left = self._peeled(ways.board, target[row[ways.case]], ways.wanted)
            wanted = ways.wanted & left
            freed = ways.case[(wanted == 0).all(-1)]
            is_open[row[freed], lane[freed]] = True
            untried = (ways.spare > 0) & ~is_open[row[ways.case], lane[ways.case]]
            ways = _Ways(*(field[untried] for field in (ways.case, left, wanted, ways.spare)))
            if len(ways.case) > MAX_WAYS:
                is_open[row[ways.case], lane[ways.case]] = True
                break
            ways = self._branches(ways, target[row[ways.case]])
        return is_open

    def _branches(self, ways: _Ways, target: Tensor) -> _Ways:
        """For each obstacle that is wanted, and each of its lanes, the way that frees it first."""
        way, cell = boards.unpack(ways.wanted, self.reach.n_cells).nonzero(as_tuple=True)
        sets = self.sets[cell]
        others = ways.wanted | boards.bit(target, ways.board.shape[-1])
        blockers = sets & ways.board[way, None]
        cost = boards.count(blockers)
        possible = (cost <= ways.spare[way, None]) & ((sets & others[way, None]) == 0).all(-1)
        at, lane = possible.nonzero(as_tuple=True)
        way = way[at]
        wanted = ways.wanted[way] | blockers[at, lane]
        order, first = distinct(torch.cat([wanted, ways.board[way]], -1), ways.case[way])
        kept = order[first]
        way = way[kept]
        return _Ways(ways.case[way], ways.board[way], wanted[kept], ways.spare[way] - cost[at, lane][kept])

    def _peeled(self, board: Tensor, target: Tensor, among: Tensor) -> Tensor:
        """Int64[N, W]: the boards left when obstacles of `among` vanish as the hand gets to them, until none can."""
        target_bit = boards.bit(target, board.shape[-1])
        while bool((among != 0).any()):
            # `rules.pickable`, of those that are wanted alone.
            gone = self._packed(self.reach.free(board | target_bit)) & among
            if not bool((gone != 0).any()):
                break
            board = board & ~gone
            among = among & ~gone
        return board

    def _packed(self, cells: Tensor) -> Tensor:
        """`board.pack`, without making the bits anew each time."""
        return torch.stack([(cells * bits).sum(-1) for bits in self.bits], -1)


def fewest_blocking(reach: Reach, start: Batch) -> Tensor:
    """Int64[N]: obstacles on the target's best lane, each of which has to go: no plan is shorter."""
    return boards.count(start.board & reach.blocking_sets[:, start.target]).amin(0)
