"""The style that all figures share: colours, resolution, plain axes, and how a figure is saved."""

from __future__ import annotations

import os

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dore.files import atomic_write

RED, GREEN, BLUE, OCHRE, PURPLE = "#c8553d", "#2e8b57", "#4c78a8", "#e0a030", "#8a5aa8"
"""For things that must be distinguished; `SERIES` gives their order in a plot."""
SERIES = (BLUE, RED, GREEN, OCHRE, PURPLE)
INK, FAINT = "#2b2d33", "#8b8f98"
"""Text and lines; secondary text and reference lines."""
EMPTY, EDGE, GRID = "#f6f6f4", "#d4d5d8", "#e6e6e6"
"""An empty cell, its edge, and grid lines."""
DPI = 200


def plain(axes: Axes) -> None:
    """A light grid, small dark tick labels, no frame at the top and right."""
    axes.tick_params(labelsize=8, colors=INK)
    axes.grid(color=GRID, lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def save_figure(figure: Figure, path: str | os.PathLike[str], dpi: int = DPI) -> None:
    """Write the figure; an interruption leaves the old file, or none.

    Raises:
        OSError: the file cannot be written.
    """
    with atomic_write(path, "wb") as file:
        figure.savefig(file, format="png", dpi=dpi)
