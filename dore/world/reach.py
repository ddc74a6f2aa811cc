"""Which cells the hand can reach on a board: the modified VFH+ of the paper's Appendix A, as a table.

For a fixed layout the histogram needs no geometry at run time: each (cell, sector) has a fixed set of cells
that block it, and a sector is free when the board and that set do not meet.
"""

from __future__ import annotations

import copy
import math
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from dore.errors import InputError, number, whole
from dore.world import histogram
from dore.world.device import device_of
from dore.world.kernels.replay import Sectors
from dore.world.kernels.tables import Table, table_of
from dore.world.layout import Layout

if TYPE_CHECKING:  # Half of a cold start: plans of compiled planners do without.
    import torch
    from torch import Tensor

MAX_SECTORS = 720
MAX_TABLE = 64_000_000
"""Entries of the table, cells x sectors x cells: 32 x 32 cells with 60 sectors are the most, and take some seconds."""
TENSORS = ("sectors_deg", "mirror", "allowed_sectors", "blockers", "blocking_sets", "_reachable")
"""What is made into tensors, on the reach's device, when it is first asked for."""


class Reach:
    """The accessibility check of a layout (paper eq. 13 and Appendix A).

    The histogram is centred on the cell that is picked or placed; 0 degrees points from it to the robot base.
    An obstacle at distance d and bearing b covers the sectors in [b - asin(r/d), b + asin(r/d)], 90 degrees
    to each side where r >= d. A cell is accessible when an allowed sector is covered by no obstacle.

    Not in the paper: a sector can be ruled out for a cell beforehand, because the arm cannot follow that approach
    corridor.

    Args:
        clearance_m: r, half the width of the approach corridor that an obstacle's centre must stay out of, metres.
        half_fan_deg: sectors span [-half_fan_deg, +half_fan_deg].
        n_sectors: how many sectors, evenly spaced, ends included.
        staging_m: how far before the layout's front edge the staging line lies, metres.
        lateral_limit_m: largest |y| at which a corridor may cross the staging line, metres; None: no limit.
        max_yaw_deg: largest angle between a corridor and the robot's x axis; None: no limit.

    Raises:
        InputError: a parameter outside its domain.
    """

    def __init__(
        self,
        layout: Layout,
        clearance_m: float,
        half_fan_deg: float,
        n_sectors: int,
        staging_m: float = 0.0,
        lateral_limit_m: float | None = None,
        max_yaw_deg: float | None = None,
    ) -> None:
        self.layout = layout
        self.clearance_m = number("reach.clearance_m", clearance_m, above=0.0, at_most=1.0, unit="metres")
        self.half_fan_deg = number("reach.half_fan_deg", half_fan_deg, above=0.0, at_most=180.0)
        self.n_sectors = whole("reach.n_sectors", n_sectors, 2, at_most=MAX_SECTORS)
        self.staging_m = number("reach.staging_m", staging_m, above=-1e-12, at_most=5.0, unit="metres")
        self.lateral_limit_m = (
            None
            if lateral_limit_m is None
            else number("reach.lateral_limit_m", lateral_limit_m, above=0.0, at_most=10.0, unit="metres")
        )
        self.max_yaw_deg = (
            None if max_yaw_deg is None else number("reach.max_yaw_deg", max_yaw_deg, above=0.0, at_most=180.0)
        )
        size = layout.n_cells**2 * self.n_sectors
        if size > MAX_TABLE:
            raise InputError(
                f"reach.n_sectors: {self.n_sectors} on {layout.n_cells} cells make a table of {size:,} entries, "
                f"want {MAX_TABLE:,} at most: fewer sectors or cells"
            )
        degrees = histogram.evenly(self.half_fan_deg, self.n_sectors)
        blocking = histogram.blockers(layout.places, degrees, self.clearance_m)
        self.degrees = [*degrees.tolist(), math.nan]
        """Of each sector, counter-clockwise; and at the end, as of no sector, nan."""
        allowed = histogram.followed(
            layout.places, degrees, layout.front_m - self.staging_m, self.lateral_limit_m, self.max_yaw_deg
        )
        self.histogram = Sectors(blocking, allowed, np.abs(degrees).argsort(kind="stable"))
        """All sectors of each cell, as the compiled replay takes them."""
        self._device = "cpu"

    @property
    def n_cells(self) -> int:
        """G."""
        return self.layout.n_cells

    @property
    def n_words(self) -> int:
        """W."""
        return int(self.histogram.blockers.shape[-1])

    @property
    def device(self) -> torch.device:
        """Where the tensors lie."""
        return self.blockers.device

    def to(self, device: torch.device | str) -> Reach:
        """The same reach with its tensors on `device`.

        Raises:
            InputError: no such device.
        """
        moved = copy.copy(self)
        if device != self._device:
            moved._device = str(device_of(device))
            for name in TENSORS:
                vars(moved).pop(name, None)
        return moved

    @cached_property
    def sectors_deg(self) -> Tensor:
        """Float64[S]: degrees about the direction to the base, counter-clockwise."""
        return self._tensor(np.array(self.degrees[:-1]))

    @cached_property
    def mirror(self) -> Tensor | None:
        """As of the layout."""
        return None if self.layout.mirror is None else self.layout.mirror.to(self._device)

    @cached_property
    def allowed_sectors(self) -> Tensor:
        """Bool[G, S]: the corridors the arm itself can follow, whatever stands on the board."""
        return self._tensor(self.histogram.allowed)

    @cached_property
    def blockers(self) -> Tensor:
        """Int64[G, S, W]: the cells on which an obstacle covers a sector."""
        return self._tensor(self.histogram.blockers.view(np.int64))

    @cached_property
    def blocking_sets(self) -> Tensor:
        """Int64[D, G, W]: see `histogram.undominated`."""
        return self._tensor(self._sets.view(np.int64))

    @cached_property
    def _reachable(self) -> Tensor:
        """Bool[G]: whether any corridor leads to a cell."""
        return self.allowed_sectors.any(-1)

    @cached_property
    def _sets(self) -> np.ndarray:
        return histogram.undominated(self.histogram.blockers, self.histogram.allowed)

    @cached_property
    def table(self) -> Table:
        """The corridors of each cell, as the compiled kernels take them.

        Raises:
            InputError: the layout has more cells than the kernels hold.
        """
        return table_of(self._sets, np.asarray(self.histogram.allowed.any(-1)), self.n_cells)

    def _tensor(self, array: np.ndarray) -> Tensor:
        import torch

        return torch.from_numpy(array).to(self._device)

    def same_as(self, other: Reach) -> bool:
        """Whether both judge the same cells alike."""
        return self.layout.coincides(other.layout) and self.to_dict() == other.to_dict()

    def __str__(self) -> str:
        """As messages name it."""
        return f"{self.layout} with a clearance of {self.clearance_m:g} m"

    def accessible(self, occupied: Tensor) -> Tensor:
        """Which cells a hand can get to, each cell judged with itself taken off the board.

        Args:
            occupied: Bool[B, G]; True where anything stands, the target included.

        Returns:
            Bool[B, G].

        Raises:
            InputError: `occupied` is not a boolean tensor of that shape.
        """
        import torch

        from dore.world import board as boards

        if occupied.dtype is not torch.bool or occupied.ndim != 2 or occupied.shape[1] != self.n_cells:
            raise InputError(f"occupied: got {occupied.dtype}{list(occupied.shape)}, want Bool[B, {self.n_cells}]")
        return self.accessible_packed(boards.pack(occupied))

    def accessible_packed(self, board: Tensor) -> Tensor:
        """`accessible` for packed boards: Int64[B, W] -> Bool[B, G]; a loop over D, so no (B, G, D) temporary.

        Raises:
            InputError: other boards, as of 32 bits, which would lose cells.
        """
        import torch

        if board.dtype != torch.int64 or board.shape[1:] != (self.n_words,):
            raise InputError(f"board: got {board.dtype}{list(board.shape)}, want Int64[B, {self.n_words}]")
        words = [word[:, None] for word in board.unbind(-1)]
        free = torch.zeros(len(board), self.n_cells, dtype=torch.bool, device=board.device)
        for mask in self.blocking_sets.unbind(0):
            blocked = words[0] & mask[:, 0]
            for w, word in enumerate(words[1:], 1):
                blocked = blocked | (word & mask[:, w])
            free |= blocked == 0
        return free & self._reachable

    def cell_accessible(self, board: Tensor, cell: Tensor) -> Tensor:
        """`accessible` of one cell a board: Int64[B, W], Int64[B] -> Bool[B]."""
        blocked = (board[:, None] & self.blocking_sets[:, cell].transpose(0, 1)) != 0
        return ~blocked.any(-1).all(-1) & self._reachable[cell]

    def free_sectors(self, board: Tensor, cell: Tensor) -> Tensor:
        """Bool[B, S]: the allowed sectors of Int64[B] cells that Int64[B, W] boards leave free."""
        blocked = ((board[:, None] & self.blockers[cell]) != 0).any(-1)
        return ~blocked & self.allowed_sectors[cell]

    def direction_deg(self, board: Tensor, cell: Tensor) -> Tensor:
        """The approach direction: the free sector nearest 0 degrees, the clockwise one of two as near.

        Args:
            board: Int64[B, W].
            cell: Int64[B]; the cell itself does not block itself.

        Returns:
            Float64[B], degrees about the direction from the cell to the base, counter-clockwise; nan for a cell that
            is not accessible.
        """
        import torch

        free = self.free_sectors(board, cell)
        from_zero = torch.where(free, self.sectors_deg.abs(), math.inf)
        return self.sectors_deg[from_zero.argmin(-1)].masked_fill(~free.any(-1), math.nan)

    def to_dict(self) -> dict[str, Any]:
        """The parameters as plan files and model files hold them: without limits that are not set."""
        names = ("clearance_m", "half_fan_deg", "n_sectors", "staging_m", "lateral_limit_m", "max_yaw_deg")
        return {name: value for name in names if (value := getattr(self, name))}
