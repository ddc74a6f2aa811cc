"""Figures of a source's rows, not of cells: a histogram, and rays from points."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from dore.draw.style import INK
from dore.report.expressions import chosen, numbers
from dore.report.frame import Source, Spec
from dore.report.panels import COLOURS, finish, legend, panels


def histogram(spec: Spec, cells: pd.DataFrame, sources: Mapping[str, Source]) -> Figure | None:
    """How often each value of `of` occurs, up to `most` in bins of `bin`: the series stacked; a `line`."""
    rows = sources[spec["from"]].rows
    if rows.empty:
        return None
    figure, (axes,) = panels(1, 1, 6.4, 4.2)
    groups = [numbers(chosen("figures.series", rows, one), spec["of"]) for one in spec["series"]]
    look: dict[str, Any] = {
        "color": [COLOURS[one["colour"]] for one in spec["series"]],
        "label": [one["label"] for one in spec["series"]],
    }
    axes.hist(groups, bins=np.arange(0.0, spec["most"] + spec["bin"], spec["bin"]).tolist(), stacked=True, **look)
    finish(axes, x=spec["x"], y=spec["y"])
    if "line" in spec:
        at = float(sources[spec["line"]["from"]].rows[spec["line"]["at"]].iloc[0])
        axes.axvline(at, color=INK, lw=1.2)
        place: dict[str, Any] = {"xycoords": ("data", "axes fraction"), "ha": "center", "fontsize": 7.5, "color": INK}
        axes.annotate(spec["line"]["text"], (at, 1.01), **place)
    legend(figure, [axes], 4)
    return figure


def rays(spec: Spec, cells: pd.DataFrame, sources: Mapping[str, Source]) -> Figure | None:
    """A short line for each row, from (`x_of`, `y_of`) in direction `angle_of` (degrees), in its series' colour."""
    rows = sources[spec["from"]].rows
    if rows.empty:
        return None
    figure, (axes,) = panels(1, 1, 7.2, 3.8)
    for one in spec["series"]:
        here = chosen("figures.series", rows, one)
        if here.empty:
            continue
        start = np.stack([numbers(here, spec["x_of"]), numbers(here, spec["y_of"])], -1)
        angle = np.radians(numbers(here, spec["angle_of"]).to_numpy())
        end = start + spec["length"] * np.stack([np.cos(angle), np.sin(angle)], -1)
        lines = np.stack([start, end], 1)
        axes.add_collection(LineCollection(list(lines), colors=COLOURS[one["colour"]], lw=0.4, label=one["label"]))
    axes.autoscale()
    for name, group in rows.groupby(spec["name"], sort=False):
        at = (float(numbers(group, spec["x_of"]).iloc[0]), float(numbers(group, spec["y_of"]).iloc[0]))
        axes.annotate(str(name), at, (0, 3), textcoords="offset points", ha="center", fontsize=9, color=INK)
    finish(axes, x=spec["x"], y=spec["y"])
    axes.set_aspect("equal")
    axes.margins(0.06)
    legend(figure, [axes], 4)
    return figure
