"""Boards as text, seen by someone behind the robot: the last line is row 0, the left column is column 0.

`.` empty, `o` obstacle, `T` target; a letter or digit of your own names a cell.
"""

from __future__ import annotations

from dore.world.layout import Layout
from dore.world.problem import Scene
from dore.world.reach import Reach

WIDE_HAND = {"clearance_m": 0.142, "half_fan_deg": 15.0, "n_sectors": 30}
PUBLISHED = {"clearance_m": 0.106, "half_fan_deg": 30.0, "n_sectors": 60}


def grid(drawing: str) -> list[str]:
    """The drawing's rows, nearest the robot first."""
    return [line.replace(" ", "") for line in reversed(drawing.split("\n")) if line.strip()]


def cells_of(drawing: str, mark: str) -> list[int]:
    """The cells drawn with one of the characters of `mark`, ascending."""
    return [cell for cell, here in enumerate("".join(grid(drawing))) if here in mark]


def scene_of(drawing: str, cell_m: float = 0.12) -> Scene:
    """The scene of a drawing with one T."""
    rows = grid(drawing)
    layout = Layout.grid(len(rows), len(rows[0]), cell_m)
    (target,) = cells_of(drawing, "T")
    return Scene(layout, tuple(cells_of(drawing, "o")), target)


def wide_hand(rows: int, cols: int, cell_m: float = 0.12) -> Reach:
    """The default reach on a regular layout."""
    return Reach(Layout.grid(rows, cols, cell_m), **WIDE_HAND)  # type: ignore[arg-type]
