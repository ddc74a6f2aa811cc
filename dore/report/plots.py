"""The figures of a study: lines over columns, learning curves, dots and heat maps, in one style."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter

from dore.draw import style
from dore.draw.style import FAINT, INK, SERIES
from dore.errors import InputError
from dore.report.expressions import chosen, numbers
from dore.report.frame import Source, Spec
from dore.report.panels import COLOURS, finish, legend, panels
from dore.report.row_plots import histogram, rays

DASHES = (0, (4, 3))
SHORT = FuncFormatter(lambda x, _: f"{x / 1e6:g}M" if x >= 1e6 else f"{x / 1e3:g}k" if x >= 1e3 else f"{x:g}")
"""1000 as 1k, so that large numbers do not touch each other."""


def draw(path: Path, spec: Spec, cells: pd.DataFrame, sources: Mapping[str, Source]) -> None:
    """Write a study's figure as PNG; one that a program draws, or whose runs are not there, stays as it is.

    Raises:
        InputError: a kind that is not known.
    """
    kind = spec.get("kind")
    if kind is None:
        return
    if kind not in FIGURES:
        raise InputError(f"figures: kind {kind!r}, want one of {', '.join(FIGURES)}")
    figure = FIGURES[kind](spec, cells, sources)
    if figure is not None:
        style.save_figure(figure, path)


def _lines(spec: Spec, cells: pd.DataFrame, sources: Mapping[str, Source]) -> Figure:
    """One panel per metric: rows as lines over columns, numbers or categories, with intervals; the paper's dashed."""
    figure, axes = panels(len(spec["panels"]), 3, 4.8, 3.8)
    for one, panel in zip(axes, spec["panels"], strict=True):
        mine = cells[(cells.metric == panel["metric"]) & cells["mean"].notna()].copy()
        if "rows" in panel:
            mine = mine[mine["row"].str.contains(panel["rows"])]
        mine["x"] = _places(mine.column, spec.get("categories"))
        mine = mine[mine.x.notna()]
        styles = _styles(spec, list(dict.fromkeys(mine["row"])))
        for place, (row, line) in enumerate(mine.groupby("row", sort=False)):
            _line(one, str(row), line, styles[str(row)], place, spec.get("band", True))
        if panel.get("log"):
            one.set_yscale("log")
            one.set_ylim(bottom=0.5 * mine["mean"].min())
        elif "bottom" in panel:
            one.set_ylim(bottom=panel["bottom"])
        finish(one, title=panel.get("title", ""), x=spec.get("x", ""), y=panel.get("y", panel["metric"]))
        if "categories" in spec:
            one.set_xticks(range(len(spec["categories"])), spec["categories"])
        else:
            one.xaxis.set_major_locator(MaxNLocator(integer=True))
        if "mark" in panel:
            one.axvline(panel["mark"]["at"], color=FAINT, lw=1, ls=(0, (1, 3)))
            at, text = (panel["mark"]["at"], 1.01), panel["mark"]["text"]
            one.annotate(text, at, xycoords=("data", "axes fraction"), ha="center", fontsize=7.5, color=FAINT)
    legend(figure, axes, 3 if len(axes) == 1 else 4)
    return figure


def _places(columns: pd.Series, categories: Sequence[str] | None) -> pd.Series:
    """Where columns stand on the x axis: their number, or their place among a study's categories; nan: nowhere."""
    if categories is None:
        return columns.str.extract(r"^([\d.]+)(?: %)?$", expand=False).astype(float)
    return columns.map({name: float(place) for place, name in enumerate(categories)})


def _styles(spec: Spec, rows: Sequence[str]) -> dict[str, tuple[Any, Any]]:
    """Each row's colour and line style: those that the study names, or a colour per size and a style per planner."""
    if "colours" in spec:
        return {
            row: (COLOURS[spec["colours"].get(row, "faint")], DASHES if _is_paper_row(row) else "-") for row in rows
        }
    heads = list(dict.fromkeys(row.rpartition(", ")[0] for row in rows))
    colours = dict(zip(heads, colormaps["viridis"](np.linspace(0.0, 0.9, len(heads))), strict=True))
    tails = list(dict.fromkeys(row.rpartition(", ")[2] for row in rows))
    return {
        row: (colours[(parts := row.rpartition(", "))[0]], ("-", DASHES)[tails.index(parts[2]) % 2]) for row in rows
    }


def _is_paper_row(row: str) -> bool:
    return row.startswith("paper")


def _line(axes: Axes, row: str, line: pd.DataFrame, look: tuple[Any, Any], place: int, band: bool) -> None:
    colour, dashes = look
    if _is_paper_row(row):
        # Two rows of the paper stand a little apart, so that their bars do not overlap.
        x = line.x + 0.12 * (place - 0.5)
        half, what = (line.high - line["mean"], "") if line.sd.isna().all() else (line.sd, " (sd)")
        axes.errorbar(
            x, line["mean"], half, color=colour, lw=1, ls=dashes, elinewidth=0.8, capsize=2, marker="o", ms=4,
            mfc="white", label=f"{row}{what}",
        )  # fmt: skip
        return
    axes.plot(line.x, line["mean"], color=colour, lw=1.4, ls=dashes, marker="o", ms=3, label=row)
    if band:
        axes.fill_between(line.x, line.low, line.high, color=colour, alpha=0.18, lw=0)


def _curves(spec: Spec, cells: pd.DataFrame, sources: Mapping[str, Source]) -> Figure | None:
    """One panel per value of `by`: each series' success over `x`; several runs as their mean and a band over all."""
    frames = [(one, chosen("figures.series", sources[one["from"]].rows, one)) for one in spec["series"]]
    frames = [(one, rows) for one, rows in frames if not rows.empty]
    if not frames:
        return None
    titles = list(dict.fromkeys(title for _, rows in frames for title in rows[spec["by"]]))
    titles = [one for one in spec.get("titles", titles) if one in titles]
    figure, axes = panels(len(titles), 3, 3.6, 2.9, share=bool(spec.get("share")))
    for one, title in zip(axes, titles, strict=True):
        finish(one, spec.get("titles", {}).get(title, title), spec["x_label"], spec["y_label"])
        one.set_ylim(0, 103)
        for series, rows in frames:
            here = rows[rows[spec["by"]] == title]
            if not here.empty:
                _curve(one, series, here, spec)
        if spec.get("log"):
            one.set_xscale("log")
            one.xaxis.set_minor_formatter(NullFormatter())
        one.xaxis.set_major_formatter(SHORT)
    legend(figure, axes, 5)
    return figure


def _curve(axes: Axes, series: Spec, rows: pd.DataFrame, spec: Spec) -> None:
    colour, known = COLOURS[series["colour"]], rows[rows[spec["x"]].notna()]
    if "level" in series:
        level = float(rows[series["level"]].iloc[0])
        axes.axhline(level, color=colour, lw=1, ls=DASHES, label=series["level_label"])
    if "end" in series:
        axes.set_xlim(0, float(rows[series["end"]].iloc[-1]))
    if known.empty:
        return
    runs = [one for _, one in known.groupby(series["over"])] if "over" in series else [known]
    x, low, mean, high = band([(one[spec["x"]].to_numpy(), numbers(one, spec["y"]).to_numpy()) for one in runs])
    marker = "o" if len(x) < 30 else ""
    axes.plot(x, mean, color=colour, lw=1, marker=marker, ms=2.5, label=series["label"])
    if len(runs) > 1:
        axes.fill_between(x, low, high, color=colour, alpha=0.2, lw=0)
    if "ticks" in series:
        every = float(rows[series["ticks"]].iloc[0])
        copies = np.arange(every, x[-1], every)
        axes.plot(copies, np.full(len(copies), 1.5), "|", color=FAINT, ms=5, mew=0.8)


def band(runs: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, ...]:
    """x, and the lowest, mean and highest y of several runs there, as far as all of them go.

    Runs are tested at different x; between two tests y is taken as a straight line.
    """
    first, last = max(x[0] for x, _ in runs), min(x[-1] for x, _ in runs)
    at = np.unique([*(one for x, _ in runs for one in x if first <= one <= last), last])
    values = np.array([np.interp(at, x, y) for x, y in runs])
    return at, values.min(0), values.mean(0), values.max(0)


def _dots(spec: Spec, cells: pd.DataFrame, sources: Mapping[str, Source]) -> Figure:
    """One panel per metric: a dot for each row, with its range; a dashed line at the first row of each kind.

    A row's kind is what its name has before a colon; rows without one are drawn faint.
    """
    figure, axes = panels(len(spec["metrics"]), 2, 5.2, 0.3 * max(cells.groupby("metric")["row"].nunique()) + 0.6)
    for one, metric in zip(axes, spec["metrics"], strict=True):
        mine = cells[(cells.metric == metric) & (cells.column == spec["column"])].reset_index(drop=True)
        kinds = mine["row"].str.partition(": ")[0]
        named = dict.fromkeys(kinds[mine["row"].str.contains(": ")])
        colours = dict(zip(named, cycle(SERIES), strict=False))
        for kind, line in mine.groupby(kinds, sort=False):
            colour = colours.get(kind, FAINT)
            one.hlines(line.index, line.low, line.high, color=colour, lw=1.4)
            one.plot(line["mean"], line.index, "o", mfc="white", mec=colour, ms=6)
            one.plot(
                [line["mean"].iloc[0]] * 2, [line.index[0], line.index[-1]], color=colour, lw=1, ls=DASHES, zorder=0
            )
        finish(one, metric, spec["x"])
        one.set_yticks(range(len(mine)), list(mine["row"]))
        one.invert_yaxis()
    return figure


def _heat(spec: Spec, cells: pd.DataFrame, sources: Mapping[str, Source]) -> Figure:
    """One panel per metric: a table of numbers as colours, and written; `frame`: a metric that is 1 where framed."""
    framed = cells[(cells.metric == spec.get("frame")) & (cells["mean"] == 1)]
    figure, axes = panels(len(spec["panels"]), 2, 4.6, 3.6)
    for one, panel in zip(axes, spec["panels"], strict=True):
        mine = cells[cells.metric == panel["metric"]]
        wide = mine.pivot(index="row", columns="column", values="mean")
        wide = wide[sorted(wide, key=_leading)].loc[sorted(wide.index, key=_leading)]
        one.imshow(wide, origin="lower", aspect="auto", cmap="viridis_r", vmin=0.0, vmax=spec["most"])
        for (row, column), value in np.ndenumerate(wide.to_numpy()):
            ink = "white" if value > 0.45 * spec["most"] else INK
            text = "-" if np.isnan(value) else f"{value:.2f}"
            one.text(column, row, text, ha="center", va="center", fontsize=8, color=ink)
        for at in framed.itertuples():
            corner = (list(wide).index(at.column) - 0.5, list(wide.index).index(at.row) - 0.5)
            one.add_patch(Rectangle(corner, 1, 1, fill=False, ec=COLOURS["red"], lw=2.5, clip_on=False, zorder=3))
        finish(one, panel.get("title", panel["metric"]), spec["x"], spec["y"])
        one.grid(visible=False)
        one.set_xticks(range(wide.shape[1]), list(wide))
        one.set_yticks(range(wide.shape[0]), list(wide.index))
    return figure


def _leading(text: str) -> float:
    """The number that a name begins with."""
    found = re.match(r"[\d.]+", text)
    return float(found[0]) if found else float("inf")


FIGURES: dict[str, Callable[[Spec, pd.DataFrame, Mapping[str, Source]], Figure | None]] = {
    "lines": _lines,
    "curves": _curves,
    "dots": _dots,
    "heat": _heat,
    "histogram": histogram,
    "rays": rays,
}
