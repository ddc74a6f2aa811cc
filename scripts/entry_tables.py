"""Metrics as CSV and as Markdown tables, whatever their columns are called."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean, stdev

from dore.files import atomic_write
from dore.report.intervals import UNKNOWN, Interval
from dore.report.tables import Table
from scripts.paper_entries import Entry, Metric

COLUMNS = ("metric", "row", "column", "n", "mean", "sd", "low", "high")


def spread(row: str, column: str, values: Sequence[float]) -> Entry:
    """Mean (sd) [lowest, highest] over the seeds that have a value; n is how many those are."""
    values = [value for value in values if not math.isnan(value)]
    if not values:
        return Entry(row, column, 0, UNKNOWN)
    sd = stdev(values) if len(values) > 1 else math.nan
    return Entry(row, column, len(values), Interval(fmean(values), min(values), max(values)), sd)


def write_csv(path: Path, metrics: Sequence[Metric]) -> None:
    """A line a cell; what there is none of is left empty."""
    with atomic_write(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for metric in metrics:
            for entry in metric.entries:
                numbers = (entry.value.value, entry.sd, entry.value.low, entry.value.high)
                shown = ["" if math.isnan(number) else f"{number:.6g}" for number in numbers]
                writer.writerow([metric.name, entry.row, entry.column, "" if entry.n is None else entry.n, *shown])


def table(metric: Metric, columns: Sequence[str], head: str, with_n: bool = False) -> Table:
    """The metric's rows over the columns, in the order in which they come; a dash where there is nothing."""
    cells = {(entry.row, entry.column): entry for entry in metric.entries}
    rows = dict.fromkeys(entry.row for entry in metric.entries)
    return [[head, *columns]] + [
        [row, *(cell(cells.get((row, column)), metric.digits, with_n) for column in columns)] for row in rows
    ]


def cell(entry: Entry | None, digits: int, with_n: bool) -> str:
    """A cell of a Markdown table: `mean (sd) [low, high], n`, as far as there is such a thing."""
    if entry is None or math.isnan(entry.value.value):
        return "-"
    text = _number(entry.value.value, digits)
    if not math.isnan(entry.sd):
        text += f" ({_number(entry.sd, 2)})"
    if not math.isnan(entry.value.low):
        text += f" [{_number(entry.value.low, digits)}, {_number(entry.value.high, digits)}]"
    return f"{text}, n {entry.n}" if with_n and entry.n is not None else text


def _number(value: float, digits: int) -> str:
    """So many significant digits, and no exponent where there are many before the point; whole numbers as such."""
    whole = value == round(value) or abs(value) >= 10 ** (digits - 1)
    return f"{value:,.0f}" if whole else f"{value:#.{digits}g}".rstrip(".")
