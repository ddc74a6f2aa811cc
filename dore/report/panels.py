"""What all figures of a study share: panels, names, grid, legend and colours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dore.draw import style
from dore.draw.style import INK

COLOURS = {name.lower(): getattr(style, name) for name in ("RED", "GREEN", "BLUE", "OCHRE", "PURPLE", "INK", "FAINT")}


def panels(count: int, across: int, width: float, height: float, share: bool = False) -> tuple[Figure, list[Axes]]:
    """A figure and its panels; those that are too many are not shown."""
    across = min(across, count)
    down = -(-count // across)
    figure = Figure((width * across + 0.6, height * down + 0.8), facecolor="white", layout="constrained")
    axes = list(figure.subplots(down, across, squeeze=False, sharex=share, sharey=share).flat)
    for one in axes[count:]:
        one.set_visible(False)
    return figure, axes[:count]


def finish(axes: Axes, title: str = "", x: str = "", y: str = "") -> None:
    """Names, grid and ticks, the same in all figures."""
    axes.set_title(title, fontsize=9, color=INK)
    axes.set_xlabel(x, fontsize=9, color=INK)
    axes.set_ylabel(y, fontsize=9, color=INK)
    style.plain(axes)
    axes.set_axisbelow(True)


def legend(figure: Figure, axes: Sequence[Axes], across: int) -> None:
    """One legend for all panels, below them."""
    shown: dict[Any, Any] = {}
    for one in axes:
        handles, labels = one.get_legend_handles_labels()
        shown |= dict(zip(labels, handles, strict=True))
    look: dict[str, Any] = {
        "loc": "outside lower center",
        "ncols": across,
        "fontsize": 8,
        "frameon": False,
        "labelcolor": INK,
    }
    figure.legend(list(shown.values()), list(shown), **look)
