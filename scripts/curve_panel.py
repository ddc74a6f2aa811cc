"""A panel of learning curves: IPT success over episodes, one line a run or a band over seeds."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, NullFormatter

from dore.draw.style import FAINT, INK
from scripts.learning_curves import Ipt, band

RED, BLUE, GREEN = "#c8553d", "#4c78a8", "#2e8b57"
SHORT = FuncFormatter(
    lambda value, _: f"{value / 1e6:g}M" if value >= 1e6 else f"{value / 1e3:g}k" if value >= 1e3 else f"{value:g}"
)
"""1000 as 1k, so that numbers of episodes do not run into each other."""


def prepare(axes: Axes, title: str) -> None:
    """Success from 0 to 100 % over episodes, which span three powers of ten."""
    axes.set_title(title, fontsize=9, color=INK)
    axes.set_xscale("log")
    axes.set_ylim(0, 103)
    axes.xaxis.set_major_formatter(SHORT)
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.tick_params(labelsize=8, colors=INK)
    axes.grid(color="#e6e6e6", lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def mark(axes: Axes, percent: float, colour: str = FAINT, label: str | None = None, start: float = 0) -> None:
    """A success of interest, as a line of dashes; `start` moves them along it."""
    axes.axhline(percent, color=colour, lw=1, ls=(start, (4, 3)), label=label)


def draw_runs(axes: Axes, runs: Sequence[Sequence[Ipt]], colour: str, label: str) -> None:
    """The mean of several runs as far as all go, with a band from the lowest to the highest; one run is its own."""
    episodes, low, mean, high = band(runs)
    if not len(episodes):
        return
    marker = "o" if len(episodes) == 1 else ""
    axes.plot(episodes, 100 * mean, color=colour, lw=1, marker=marker, ms=3, label=label)
    if len(runs) > 1:
        axes.fill_between(episodes, 100 * low, 100 * high, color=colour, alpha=0.2, lw=0)
