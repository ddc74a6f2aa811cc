"""The figure of the paper's runs as printed: success against updates, a panel a run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dore.draw.style import DPI, FAINT, INK
from dore.files import atomic_write
from scripts.curve_panel import BLUE, RED, SHORT

if TYPE_CHECKING:
    from scripts.literal import Run

COLOURS = {"single": RED, "sequential": BLUE}
WIDE = 3


def draw(path: Path, runs: Sequence[Run]) -> None:
    """Write a PNG. The right edge of a panel is T_lim, or the updates of a run that has passed before."""
    tall = -(-len(runs) // WIDE)
    figure = Figure((4.0 * WIDE, 2.5 * tall + 0.3), facecolor="white", layout="constrained")
    panels = list(figure.subplots(tall, WIDE, squeeze=False).flat)
    for axes, run in zip(panels, runs, strict=False):
        _draw_run(axes, run)
    for axes in panels[len(runs) :]:
        axes.set_visible(False)
    figure.supxlabel(
        "updates; the right edge is T_lim, or the early stop; ticks below: the targets are copied", fontsize=9
    )
    figure.supylabel("IPT success (%)", fontsize=9)
    with atomic_write(path, "wb") as file:
        figure.savefig(file, format="png", dpi=DPI)


def _draw_run(axes: Axes, run: Run) -> None:
    seed = f", seed {run.seed}" if run.seed else ""
    reading = f", {run.reading}" if run.reading else ""
    axes.set_title(f"{run.structure}, {run.column.replace('_z', ', ')}{reading}{seed}", fontsize=9, color=INK)
    axes.set_ylim(0, 103)
    last = run.tests[-1] if run.tests else None
    axes.set_xlim(0, last.updates if last and run.ending == "passed" else run.t_lim_updates)
    axes.xaxis.set_major_formatter(SHORT)
    axes.tick_params(labelsize=8, colors=INK)
    axes.grid(color="#e6e6e6", lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.axhline(run.paper, color=INK, lw=1, ls=(0, (4, 3)))
    axes.annotate(
        f"paper {run.paper:g} %",
        (1, run.paper),
        (0, -3),
        ("axes fraction", "data"),
        "offset points",
        ha="right",
        va="top",
        fontsize=7.5,
        color=INK,
    )
    if last is None:
        return
    updates = [test.updates for test in run.tests]
    marker = "o" if len(updates) < 30 else ""
    axes.plot(updates, [test.ipt for test in run.tests], color=COLOURS[run.structure], lw=1, marker=marker, ms=2.5)
    copies = [run.copy_every * n for n in range(1, last.target_copies + 1)]
    axes.plot(copies, [1.5] * len(copies), "|", color=FAINT, ms=5, mew=0.8)
    if run.ending is None:
        axes.axvline(last.updates, color=FAINT, lw=0.8, ls=":")
