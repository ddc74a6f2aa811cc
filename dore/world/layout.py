"""Where the cells are. Everything else sees only G centres; that they may form a rectangle stays here."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from dore.errors import InputError, number, shown, whole
from dore.schema import checked

if TYPE_CHECKING:
    from torch import Tensor

MAX_CELLS = 1024
"""The accessibility table grows with the square of the cells."""
OBJECT_M = 0.07
"""The paper's objects are this wide, so cells that lie nearer cannot both hold one."""
MAX_CELL_M = 1.0
"""No cell is larger, which distinguishes metres from centimetres."""
FARTHEST_M = 10.0
"""No centre is farther from the base, for the same reason."""
TABLE_CENTRE_M = 0.75
"""How far ahead of the base a regular layout's centre stands unless its front edge is given, metres."""


@dataclass(frozen=True)
class Layout:
    """G square cells on the table, in the robot's base frame (REP-103: +x away from the robot, +y left).

    cells: centre (x, y) of each cell, metres; a cell's id is its place in this tuple.
    cell_m: edge of a cell, metres.
    grid_shape: (rows, cols) where the cells form a rectangle, row-major from the robot's near left.
    """

    cells: tuple[tuple[float, float], ...]
    cell_m: float
    grid_shape: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "cell_m", _edge(self.cell_m))
        object.__setattr__(self, "cells", _centres(self.cells))
        if self.grid_shape is not None:
            object.__setattr__(self, "grid_shape", _shape(self.grid_shape, self.cells, self.cell_m))
        gap, one, other = _nearest_two(self.places)
        if gap < OBJECT_M - 1e-9:
            raise InputError(
                f"layout.cells: the centres of cells {one + 1} and {other + 1} are {gap:.3g} m apart, "
                f"want {OBJECT_M:g} m or more, so that objects on both do not touch"
            )
        if gap < self.cell_m / math.sqrt(2) - 1e-9:
            raise InputError(
                f"layout.cell_m: got {self.cell_m:g}, and the centres of cells {one + 1} and {other + 1} are "
                f"{gap:.3g} m apart, want {gap * math.sqrt(2):.3g} m at most, so that cells do not overlap"
            )

    @classmethod
    def grid(cls, rows: int, cols: int, cell_m: float, front_m: float | None = None) -> Layout:
        """rows x cols squares; row 0 is nearest the robot, column 0 on its left, id = row * cols + col.

        front_m: x of the near edge, metres; None puts the table's centre 0.75 m ahead of the base.

        Raises:
            InputError: a count below 1, a size that is not finite and positive, a cell behind the base.
        """
        rows = whole("layout.rows", rows, 1, at_most=MAX_CELLS)
        cols = whole("layout.cols", cols, 1, at_most=MAX_CELLS)
        whole("layout.rows x layout.cols", rows * cols, 1, at_most=MAX_CELLS)
        cell_m = _edge(cell_m)
        if front_m is None:
            front_m = TABLE_CENTRE_M - rows * cell_m / 2
            if front_m <= 0:
                raise InputError(
                    f"layout.rows: {rows} rows of {cell_m:g} m reach behind the base when the table's centre "
                    f"is {TABLE_CENTRE_M:g} m ahead; want fewer rows, smaller cells or front_m"
                )
        front_m = number("layout.front_m", front_m, above=0.0, at_most=FARTHEST_M, unit="metres")
        cells = tuple(
            (front_m + cell_m * (row + 0.5), cell_m * ((cols - 1) / 2 - col))
            for row in range(rows)
            for col in range(cols)
        )
        return cls(cells, cell_m, (rows, cols))

    @property
    def n_cells(self) -> int:
        """G."""
        return len(self.cells)

    @property
    def front_m(self) -> float:
        """x of the edge nearest the robot, metres."""
        return min(x for x, _ in self.cells) - self.cell_m / 2

    @cached_property
    def places(self) -> np.ndarray:
        """float64[G, 2]: centre of each cell, metres."""
        return np.array(self.cells)

    @cached_property
    def centres(self) -> Tensor:
        """Float64[G, 2]: the same as a tensor."""
        import torch

        return torch.tensor(self.cells, dtype=torch.float64)

    @cached_property
    def mirror(self) -> Tensor | None:
        """Int64[G]: each cell's mirror image about the robot's x axis; None where the layout has none."""
        import torch

        distance = torch.cdist(self.centres * torch.tensor([1.0, -1.0], dtype=torch.float64), self.centres)
        nearest, cell = distance.min(-1)
        return cell if bool((nearest < 1e-6).all()) else None

    def coincides(self, other: Layout) -> bool:
        """Whether both have the same cells in the same order, to the nanometre to which files are rounded."""
        if self == other:
            return True
        if self.n_cells != other.n_cells or not math.isclose(self.cell_m, other.cell_m, abs_tol=1e-9):
            return False
        return bool(np.abs(self.places - other.places).max() <= 1e-9)

    def __str__(self) -> str:
        """As messages name it."""
        size = f"{self.n_cells} cells" if self.grid_shape is None else "{} x {} cells".format(*self.grid_shape)
        return f"{size} of {self.cell_m:g} m from x = {self.front_m:g} m"

    def to_dict(self) -> dict[str, Any]:
        """The layout as the JSON files hold it."""
        if self.grid_shape is None:
            return {"cells": [list(cell) for cell in self.cells], "cell_m": self.cell_m}
        rows, cols = self.grid_shape
        return {"rows": rows, "cols": cols, "cell_m": self.cell_m, "front_m": round(self.front_m, 9)}

    @classmethod
    def from_dict(cls, data: object) -> Layout:
        """The inverse of `to_dict`.

        Raises:
            InputError: a missing, unknown or bad key.
        """
        if isinstance(data, dict) and "cells" in data:
            irregular = checked(data, _Cells, "layout")
            return cls(tuple(irregular.cells), irregular.cell_m)
        grid = checked(data, _Grid, "layout")
        return cls.grid(grid.rows, grid.cols, grid.cell_m, grid.front_m)


class _Grid(msgspec.Struct, forbid_unknown_fields=True):
    rows: int
    cols: int
    cell_m: float
    front_m: float | None = None


class _Cells(msgspec.Struct, forbid_unknown_fields=True):
    cells: list[tuple[float, float]]
    cell_m: float


def _edge(value: object) -> float:
    return number("layout.cell_m", value, above=OBJECT_M - 1e-9, at_most=MAX_CELL_M, unit="metres")


def _centres(cells: object) -> tuple[tuple[float, float], ...]:
    """Pairs of floats from pairs of numbers, NumPy's and torch's among them.

    Raises:
        InputError: no pairs, none or too many of them, or one that is not ahead of the base.
    """
    try:
        found = tuple((x, y) for x, y in cells)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        raise InputError(f"layout.cells: got {shown(cells)}, want a list of [x, y] in metres") from None
    whole("layout: how many cells", len(found), 0, at_most=MAX_CELLS)
    if not found:
        raise InputError("layout.cells: got none, want one centre or more")
    centres = []
    for cell, (x, y) in enumerate(found, 1):
        place = (number(f"layout.cells: x of cell {cell}", x), number(f"layout.cells: y of cell {cell}", y))
        if place[0] <= 0 or math.hypot(*place) > FARTHEST_M:
            wanted = f"want it ahead of the base and within {FARTHEST_M:g} m"
            raise InputError(f"layout: centre of cell {cell} is ({place[0]:g}, {place[1]:g}), {wanted}")
        centres.append(place)
    return tuple(centres)


def _shape(shape: Any, cells: tuple[tuple[float, float], ...], cell_m: float) -> tuple[int, int]:
    """(rows, cols), if the cells stand as `Layout.grid` puts them: files hold nothing else of a rectangle.

    Raises:
        InputError: no pair of counts, or the cells stand elsewhere.
    """
    try:
        given_rows, given_cols = shape
    except (TypeError, ValueError):
        raise InputError(f"layout.grid_shape: got {shown(shape)}, want (rows, cols) or None") from None
    rows = whole("layout.grid_shape", given_rows, 1, at_most=MAX_CELLS)
    cols = whole("layout.grid_shape", given_cols, 1, at_most=MAX_CELLS)
    x, y = cells[0]
    places = ((x + cell_m * row, y - cell_m * col) for row in range(rows) for col in range(cols))
    apart = [math.dist(cell, place) for cell, place in zip(cells, places, strict=False)]
    if rows * cols != len(cells) or max(apart) > 1e-6 or abs(y - cell_m * (cols - 1) / 2) > 1e-6:
        raise InputError(
            f"layout.grid_shape: got ({rows}, {cols}), and the cells do not form that rectangle; want None"
        )
    return rows, cols


def _nearest_two(places: np.ndarray) -> tuple[float, int, int]:
    """The smallest distance between two centres, metres, and which cells' they are; infinity for a single cell."""
    dx, dy = (places[:, None] - places).transpose(2, 0, 1)
    distance = np.hypot(dx, dy)
    np.fill_diagonal(distance, math.inf)
    one, other = divmod(int(distance.argmin()), len(places))
    return float(distance[one, other]), one, other
