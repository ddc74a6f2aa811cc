"""The figure of the ablations: how well each change does at the end, a panel a base."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from statistics import fmean

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dore.draw.style import DPI, INK
from dore.files import atomic_write
from scripts.ablation_runs import BASES, NONE, Variant
from scripts.curve_panel import BLUE, RED

COLOURS = {"sequential": BLUE, "single": RED}


def draw(path: Path, variants: Sequence[Variant]) -> None:
    """Write a PNG: a row a change, a small dot a seed, a ring their mean; unchanged as a dashed line."""
    bases = [base for base in BASES if any(one.base == base for one in variants)]
    most = max(sum(one.base == base for one in variants) for base in bases)
    figure = Figure((4.6 * len(bases) + 0.4, 0.3 * most + 1.4), facecolor="white", layout="constrained")
    for axes, base in zip(figure.subplots(1, len(bases), squeeze=False)[0], bases, strict=True):
        _panel(axes, base, [one for one in variants if one.base == base])
    with atomic_write(path, "wb") as file:
        figure.savefig(file, format="png", dpi=DPI)


def _panel(axes: Axes, base: str, variants: Sequence[Variant]) -> None:
    names = []
    for height, one in enumerate(variants):
        names.append(f"{one.structure}: {'unchanged' if one.change == NONE else one.change}")
        ends = [100 * tests[-1].success for tests in one.tests if tests]
        if not ends:
            continue
        colour = COLOURS[one.structure]
        axes.plot(ends, [height] * len(ends), "o", color=colour, ms=3, alpha=0.6)
        axes.plot(fmean(ends), height, "o", mfc="none", mec=colour, ms=8)
        if one.change == NONE:
            below = height + sum(other.structure == one.structure for other in variants) - 1
            axes.plot([fmean(ends)] * 2, [height, below], color=colour, lw=1, ls=(0, (4, 3)), zorder=0)
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set_title(f"from the {base} form", fontsize=9, color=INK)
    axes.set_xlabel("IPT success at the end (%): seeds, and their mean", fontsize=9, color=INK)
    axes.tick_params(labelsize=8, colors=INK)
    axes.grid(color="#e6e6e6", lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
