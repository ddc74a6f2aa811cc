"""A run's learning curve as a picture."""

from __future__ import annotations

import csv
import os
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import StrMethodFormatter

from dore.draw.style import BLUE, FAINT, GREEN, INK, RED, plain, save_png
from dore.errors import InputError


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
    _mark_target(axes[0], metrics["target_success"][-1][1])
    marker = "o" if len(metrics["success"]) < 80 else ""
    lines = (
        ("success", "IPT success (%)", GREEN, 100),
        ("loss", "loss", RED, 1),
        ("epsilon", "epsilon", BLUE, 1),
    )
    for axis, (name, label, colour, scale) in zip(axes, lines, strict=True):
        points = metrics[name]
        steps, values = [step for step, _ in points], [scale * value for _, value in points]
        axis.plot(steps, values, color=colour, lw=1.4, marker=marker if name == "success" else "", ms=3)
        axis.set_ylabel(label, fontsize=9, color=INK)
        plain(axis)
    axes[0].set_ylim(0, 103)
    axes[2].set_ylim(0, 1.05)
    axes[2].xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
    axes[2].set_xlabel("env steps", fontsize=9, color=INK)
    figure.align_ylabels(axes)
    save_png(figure, png_path)


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


def _read_metrics(path: str | os.PathLike[str]) -> dict[str, list[tuple[float, float]]]:
    """(env steps, value) of each column, where there is a value."""
    names = ("epsilon", "loss", "success", "target_success")
    points: dict[str, list[tuple[float, float]]] = {name: [] for name in names}
    try:
        with Path(path).open(encoding="utf-8", newline="") as file:
            reader = csv.DictReader(file)
            missing = sorted({"env_steps", *names} - set(reader.fieldnames or ()))
            if missing:
                raise InputError(f"{path}: no column {', '.join(missing)}")
            for record in reader:
                for name in names:
                    if record[name]:
                        points[name].append((float(record["env_steps"]), float(record[name])))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: {error}") from None
    if not points["target_success"]:
        raise InputError(f"{path}: no rows")
    return points
