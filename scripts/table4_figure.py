"""The figure of Table 4: learning curves of the literal runs and of the improved ones, a panel a column."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from dore.draw.style import DPI, INK
from dore.files import atomic_write
from scripts.curve_panel import BLUE, GREEN, RED, draw_runs, mark, prepare
from scripts.table4_metrics import IMPROVED, STRUCTURES
from scripts.table4_runs import PAPER, Runs

COLOURS = {"single": RED, "sequential": BLUE}


def titled(column: str) -> str:
    """`6 x 6, 3-8` of `6x6_z3-8`."""
    size, obstacles = column.split("_z")
    return f"{size.replace('x', ' x ')}, {obstacles}"


def draw(path: Path, runs: Runs) -> None:
    """Write a PNG: IPT success over episodes, the paper's final success dashed."""
    columns = runs.columns
    wide = min(3, len(columns))
    tall = -(-len(columns) // wide)
    figure = Figure((3.6 * wide + 0.6, 2.9 * tall + 0.8), facecolor="white", layout="constrained")
    panels = figure.subplots(tall, wide, squeeze=False, sharex=True, sharey=True)
    for axes in panels.flat[len(columns) :]:
        axes.set_visible(False)
    for axes, column in zip(panels.flat, columns, strict=False):
        prepare(axes, f"{titled(column)} obstacles")
        # Where both end at 95 %, the dashes of one fill the gaps of the other.
        for start, (structure, name) in zip((0, 3.5), STRUCTURES.items(), strict=True):
            mark(axes, PAPER[structure][column], COLOURS[structure], f"paper: {name}, in the end", start)
            if run := runs.literal.get((structure, column)):
                draw_runs(axes, [run.tests], COLOURS[structure], f"literal: {name}")
        # The same agents twice: tested often until they pass the paper's test, and tested now and then to the end.
        for trained in (runs.sooner, runs.improved):
            draw_runs(axes, [run.tests for (_, one), run in trained.items() if one == column], GREEN, IMPROVED)
    for axes in panels[-1]:
        axes.set_xlabel("episodes", fontsize=9, color=INK)
    for axes in panels[:, 0]:
        axes.set_ylabel("IPT success (%)", fontsize=9, color=INK)
    shown = {}
    for axes in panels.flat:
        handles, labels = axes.get_legend_handles_labels()
        shown.update(zip(labels, handles, strict=True))
    figure.legend(shown.values(), shown.keys(), loc="outside lower center", ncols=5, fontsize=8, frameon=False)
    with atomic_write(path, "wb") as file:
        figure.savefig(file, format="png", dpi=DPI)
