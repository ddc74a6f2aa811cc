"""The figure of a table: a panel a metric, over the number of obstacles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from dore.draw.style import DPI, FAINT, INK
from dore.files import atomic_write
from scripts.paper_entries import ALL, PAPER, Entry, Metric
from scripts.paper_metrics import MOVES, TIME
from scripts.paper_rows import TRAINED_UP_TO

RED, BLUE, GREEN, PURPLE, OCHRE = "#c8553d", "#4c78a8", "#2e8b57", "#8a5aa8", "#c9912b"
COLOURS = {
    PAPER["graph_search"]: RED,
    PAPER["baseline"]: RED,
    PAPER["dqn"]: BLUE,
    "graph_search": RED,
    "straight_line": RED,
    "learned (single)": BLUE,
    "transfer (single)": OCHRE,
    "learned (sequential)": GREEN,
    "guided": PURPLE,
    "exact": INK,
}
"""One colour a method, the paper's and ours alike."""
DODGE = 0.12
"""How far the paper's two rows stand apart, in obstacles, so that their error bars can be told apart."""


def draw(path: Path, metrics: Sequence[Metric]) -> None:
    """Write a PNG: our rows as lines with 95 % bands, the paper's dashed, with their standard deviations as bars."""
    figure = Figure((4.8 * len(metrics) + 0.6, 4.6), facecolor="white", layout="constrained")
    panels = figure.subplots(1, len(metrics), squeeze=False)[0]
    for axes, metric in zip(panels, metrics, strict=True):
        _panel(axes, metric)
    shown = {}
    for axes in panels:
        handles, labels = axes.get_legend_handles_labels()
        shown.update(zip(labels, handles, strict=True))
    figure.legend(
        shown.values(),
        shown.keys(),
        loc="outside lower center",
        ncols=4 if len(metrics) > 1 else 3,
        fontsize=8,
        frameon=False,
    )
    with atomic_write(path, "wb") as file:
        figure.savefig(file, format="png", dpi=DPI)


def _panel(axes: Axes, metric: Metric) -> None:
    rows = dict.fromkeys(entry.row for entry in metric.entries)
    of_paper = [row for row in rows if row in PAPER.values()]
    for row in rows:
        line = [entry for entry in metric.entries if entry.row == row and entry.column != ALL]
        if row in of_paper:
            _bars(axes, line, DODGE * (of_paper.index(row) - 0.5))
        else:
            _band(axes, line)
    values = [entry.value.value for entry in metric.entries]
    if metric.name == TIME:
        axes.set_yscale("log")
        axes.set_ylim(bottom=0.5 * min(values))
    elif metric.name == MOVES:
        axes.set_ylim(bottom=0)
    last = max(int(entry.column) for entry in metric.entries if entry.column != ALL)
    if last > TRAINED_UP_TO:
        axes.axvline(TRAINED_UP_TO + 0.5, color=FAINT, lw=1, ls=(0, (1, 3)))
        axes.annotate(
            f"trained up to {TRAINED_UP_TO}",
            (TRAINED_UP_TO + 0.5, 1.01),
            xycoords=("data", "axes fraction"),
            ha="center",
            fontsize=7.5,
            color=FAINT,
        )
    axes.set_ylabel(metric.name, fontsize=9, color=INK)
    axes.set_xlabel("obstacles", fontsize=9, color=INK)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.tick_params(labelsize=8, colors=INK)
    axes.grid(color="#e6e6e6", lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def _bars(axes: Axes, line: Sequence[Entry], shift: float) -> None:
    """A row of the paper."""
    x, y = [int(entry.column) + shift for entry in line], [entry.value.value for entry in line]
    axes.errorbar(
        x,
        y,
        [entry.sd for entry in line],
        color=COLOURS[line[0].row],
        lw=1,
        ls=(0, (4, 3)),
        elinewidth=0.8,
        capsize=2,
        marker="o",
        ms=4,
        mfc="white",
        label=f"{line[0].row} (sd)",
    )


def _band(axes: Axes, line: Sequence[Entry]) -> None:
    """A row of ours; a column where there is no value is left out."""
    known = [entry for entry in line if not math.isnan(entry.value.value)]
    x, colour = [int(entry.column) for entry in known], COLOURS.get(line[0].row, FAINT)
    axes.plot(x, [entry.value.value for entry in known], color=colour, lw=1.4, marker="o", ms=3, label=line[0].row)
    axes.fill_between(
        x, [entry.value.low for entry in known], [entry.value.high for entry in known], color=colour, alpha=0.18, lw=0
    )
