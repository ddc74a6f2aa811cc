"""The generalist's figure: success and rearrangements over the density, a line a size."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dore.draw.style import DPI, INK
from dore.files import atomic_write
from scripts.generalist_metrics import over_optimum, success
from scripts.generalist_worlds import PLANNERS, SIZED, Evaluations, Known, World
from scripts.paper_entries import Entry

STYLES = dict(zip(PLANNERS, ("-", (0, (3, 2))), strict=True))
SHIFT = 0.25
"""Sizes stand so far apart at a density, per cent, so that their intervals can be told apart."""


def draw(path: Path, found: Evaluations) -> None:
    """Write a PNG: success of the solvable with intervals, and the ratio to the proved optimum."""
    figure = Figure((11.0, 4.6), facecolor="white", layout="constrained")
    left, right = figure.subplots(1, 2)
    sizes = list(dict.fromkeys(world.size for world in found.sized))
    colours = colormaps["viridis"](np.linspace(0.0, 0.9, len(sizes)))
    for number, (size, colour) in enumerate(zip(sizes, colours, strict=True)):
        here = [world for world in found.sized if world.size == size]
        shift = SHIFT * (number - (len(sizes) - 1) / 2)
        for planner in PLANNERS:
            _line(left, here, planner, success, colour, shift)
            _line(right, here, planner, over_optimum, colour, shift)
    _finish(left, "success of the solvable (%)", found)
    _finish(right, "rearrangements / proved optimum", found)
    handles = [Line2D([], [], color=colour, label=size) for size, colour in zip(sizes, colours, strict=True)]
    handles += [Line2D([], [], color=INK, ls=STYLES[planner], label=planner) for planner in PLANNERS]
    for filled, label in ((INK, "learned from"), ("white", "never seen")):
        handles.append(Line2D([], [], color=INK, ls="", marker="o", ms=5, mfc=filled, label=label))
    figure.legend(handles=handles, loc="outside lower center", ncols=5, fontsize=8, frameon=False, labelcolor=INK)
    figure.suptitle(f"One network, reach {SIZED}: boards that it has learned from, and others", fontsize=11, color=INK)
    with atomic_write(path, "wb") as file:
        figure.savefig(file, format="png", dpi=DPI)


def _line(
    axes: Axes,
    worlds: list[World],
    planner: str,
    value: Callable[[World, str], Entry],
    colour: np.ndarray,
    shift: float,
) -> None:
    """One planner on one size; the intervals are the learned policy's alone."""
    intervals = [value(world, planner).value for world in worlds]
    x = np.array([world.percent + shift for world in worlds])
    y = np.array([one.value for one in intervals])
    axes.plot(x, y, color=colour, ls=STYLES[planner], lw=1.4, zorder=3)
    if planner == "learned":
        ends = np.array([[one.value - one.low, one.high - one.value] for one in intervals]).T
        axes.errorbar(x, y, np.nan_to_num(ends), fmt="none", ecolor=colour, elinewidth=0.8, alpha=0.6, capsize=2)
        for one, here, there in zip(worlds, x, y, strict=True):
            filled = colour if one.known is Known.TRAINED else "white"
            axes.plot(here, there, "o", ms=5, mec=colour, mfc=filled, zorder=4)


def _finish(axes: Axes, label: str, found: Evaluations) -> None:
    axes.set_xlabel("obstacles, % of the cells", fontsize=9, color=INK)
    axes.set_ylabel(label, fontsize=9, color=INK)
    axes.set_xticks(sorted({world.percent for world in found.sized}))
    axes.tick_params(labelsize=8, colors=INK)
    axes.grid(color="#e6e6e6", lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)
