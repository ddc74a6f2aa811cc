"""The cells that the pages of Tables 1 to 3 are made of, and the few ways in which a cell comes about."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import fmean, stdev

from dore.report.intervals import UNKNOWN, Interval, mean_interval, wilson
from scripts.paper_rows import Cell

ALL = "all"
"""The column of what is taken over all numbers of obstacles."""
PAPER = {"graph_search": "paper: graph search", "baseline": "paper: baseline", "dqn": "paper: single DQN"}
"""What a page calls the paper's rows."""


@dataclass(frozen=True)
class Entry:
    """A cell: a value with its 95 % interval, over `n` instances; n is None where the paper does not say."""

    row: str
    column: str
    n: int | None
    value: Interval
    sd: float = math.nan


@dataclass(frozen=True)
class Metric:
    """One table of a page. note: on which instances it is taken. digits: significant ones to show."""

    name: str
    note: str
    entries: list[Entry]
    digits: int = 3


def mean(row: str, column: str, values: Sequence[float]) -> Entry:
    """The mean of one value an instance."""
    return Entry(row, column, len(values), mean_interval(values), stdev(values) if len(values) > 1 else math.nan)


def share(row: str, column: str, successes: int, trials: int) -> Entry:
    """A share in percent, with Wilson's interval."""
    return Entry(row, column, trials, scaled(wilson(successes, trials), 100))


def point(row: str, column: str, value: float, n: int | None, sd: float = math.nan) -> Entry:
    """A value without an interval, such as the paper's."""
    return Entry(row, column, n, replace(UNKNOWN, value=value), sd)


def of_paper(rows: Mapping[str, Mapping[int, Cell]], columns: Iterable[int]) -> list[Entry]:
    """The paper's own cells, where it has them."""
    return [
        point(PAPER[method], str(z), cells[z].mean, cells[z].n, cells[z].sd)
        for method, cells in rows.items()
        for z in columns
        if z in cells
    ]


def means_over_columns(entries: Sequence[Entry]) -> list[Entry]:
    """For each row the mean of its columns, each weighing the same; their errors are independent."""
    found = []
    for row in dict.fromkeys(entry.row for entry in entries):
        mine = [entry for entry in entries if entry.row == row]
        value = fmean(entry.value.value for entry in mine)
        half = math.hypot(*((entry.value.high - entry.value.low) / 2 for entry in mine)) / len(mine)
        found.append(Entry(row, ALL, sum(entry.n or 0 for entry in mine), Interval(value, value - half, value + half)))
    return found


def scaled(interval: Interval, scale: float) -> Interval:
    """An interval in another unit."""
    return Interval(scale * interval.value, scale * interval.low, scale * interval.high)
