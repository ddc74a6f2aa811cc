"""The figure of the training loop's speed: where the time of an iteration goes, before and after, and over boards."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dore.curves import DPI, INK
from dore.errors import atomic_write
from scripts.training_speed_rows import Speed

COLOURS = {
    "policy": "#2e8b57",
    "environment step": "#74b790",
    "storing": "#bfe0cb",
    "sampling": "#f0d79c",
    "decoding": "#d09a2f",
    "loss": "#4c78a8",
    "backward": "#9bbad8",
    "clipping": "#eeb5a8",
    "optimiser": "#c8553d",
    "targets": "#c9b1d6",
    "mean of weights": "#8a5aa8",
    "rest": "#d3d6db",
}
"""Greens act, yellows read back, blues run the networks, red and purple change weights."""
Bars = Sequence[tuple[str, Speed, Speed]]
"""Label, what is shown, and what it is shown against."""


def draw(path: Path, groups: Sequence[Bars], boards: Bars) -> None:
    """Write a PNG: stacked bars of an iteration's time, as a share of the time of what each is shown against."""
    panels = [("before and after", groups), ("the same agent over boards, after", [boards])]
    rows = [_height(panel) for _, panel in panels]
    figure = Figure((9.2, 0.3 * sum(rows) + 2.4), facecolor="white", layout="constrained")
    for axes, (title, panel) in zip(figure.subplots(2, 1, height_ratios=rows), panels, strict=True):
        _panel(axes, title, panel)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.get_layout_engine().set(h_pad=0.12)
    # A label a stage, not one a bar.
    shown = dict(zip(labels, handles, strict=True))
    figure.legend(shown.values(), shown.keys(), loc="outside lower center", ncols=6, fontsize=8, frameon=False)
    with atomic_write(path, "wb") as file:
        figure.savefig(file, format="png", dpi=DPI)


def _height(groups: Sequence[Bars]) -> float:
    """In bars: so both panels' are as thick."""
    return sum(len(bars) + 0.6 for bars in groups)


def _panel(axes: Axes, title: str, groups: Sequence[Bars]) -> None:
    names, heights, longest, y = [], [], 100.0, 0.0
    for bars in groups:
        for label, speed, against in bars:
            times = against.env_steps_per_s / speed.env_steps_per_s
            left = 0.0
            for stage, share in speed.shares.items():
                width = 100 * times * share
                axes.barh(y, width, 0.76, left, color=COLOURS[stage], edgecolor="white", lw=0.4, label=stage)
                left += width
            ratio = "" if speed is against else f"  x {1 / times:.2f}"
            axes.annotate(
                f"{speed.env_steps_per_s:,.0f} steps/s{ratio}",
                (left, y),
                (5, 0),
                textcoords="offset points",
                va="center",
                fontsize=8,
                color=INK,
            )
            names.append(label)
            heights.append(y)
            longest = max(longest, left)
            y += 1
        y += 0.6
    axes.set_yticks(heights, names)
    axes.set_ylim(y - 0.8, -0.8)
    axes.set_xlim(0, 1.28 * longest)
    axes.set_title(title, fontsize=9, color=INK)
    axes.set_xlabel("time for as many environment steps (% of the first bar of each group)", fontsize=8.5, color=INK)
    axes.tick_params(labelsize=8, colors=INK)
    axes.grid(axis="x", color="#e6e6e6", lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
