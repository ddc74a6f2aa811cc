"""A run's learning curve as a picture."""

from __future__ import annotations

import os

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import StrMethodFormatter

from dore.draw.style import BLUE, FAINT, GREEN, INK, RED, plain, save_figure
from dore.errors import InputError

LINES = {"success": ("IPT success (%)", GREEN, 100), "loss": ("loss", RED, 1), "epsilon": ("epsilon", BLUE, 1)}
"""What is drawn, one panel per column: its name, its colour, and what it is multiplied with."""


def draw_learning_curve(csv_path: str | os.PathLike[str], png_path: str | os.PathLike[str]) -> None:
    """Write a PNG of a run's metrics over env steps: success rate with its target, loss, epsilon.

    The CSV has the columns env_steps, epsilon, loss, success (IPT success rate; empty where no IPT ran) and
    target_success; others are ignored.

    Raises:
        InputError: no such file, a missing column, no rows, or a value that is not a number.
    """
    metrics = _read_metrics(csv_path)
    figure = Figure((7.0, 5.6), facecolor="white", layout="constrained")
    axes = figure.subplots(3, 1, sharex=True, height_ratios=(2, 1.2, 0.8))
    _mark_target(axes[0], metrics["target_success"].iloc[-1])
    for axis, (name, (label, colour, scale)) in zip(axes, LINES.items(), strict=True):
        points = metrics[["env_steps", name]].dropna()
        marker = "o" if name == "success" and len(points) < 80 else ""
        axis.plot(points["env_steps"], scale * points[name], color=colour, lw=1.4, marker=marker, ms=3)
        axis.set_ylabel(label, fontsize=9, color=INK)
        plain(axis)
    axes[0].set_ylim(0, 103)
    axes[2].set_ylim(0, 1.05)
    axes[2].xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
    axes[2].set_xlabel("env steps", fontsize=9, color=INK)
    figure.align_ylabels(axes)
    save_figure(figure, png_path)


def _mark_target(axes: Axes, wanted: float) -> None:
    """The success rate that ends training, as a dashed line with its value."""
    axes.axhline(100 * wanted, color=FAINT, lw=1, ls=(0, (4, 3)))
    axes.annotate(
        f"target {100 * wanted:g} %",
        (0, 100 * wanted),
        (4, -3),
        xycoords=("axes fraction", "data"),
        textcoords="offset points",
        va="top",
        fontsize=8,
        color=FAINT,
    )


def _read_metrics(path: str | os.PathLike[str]) -> pd.DataFrame:
    """The columns that are drawn, as floats; nan where there is no value."""
    wanted = ["env_steps", *LINES, "target_success"]
    try:
        found = pd.read_csv(path)
        missing = sorted(set(wanted) - set(found))
        metrics = found.reindex(columns=wanted).astype(float)
        metrics = metrics[metrics["target_success"].notna()]  # A line that was cut off has none.
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    except ValueError as error:
        raise InputError(f"{path}: {' '.join(str(error).split())}") from None
    if missing:
        raise InputError(f"{path}: no column {', '.join(missing)}")
    if metrics.empty:
        raise InputError(f"{path}: no rows")
    return metrics
