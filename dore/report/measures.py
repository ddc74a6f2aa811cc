"""What a study may measure: each function takes the rows of one cell and returns an `Estimate`.

A study names them (`measure: solved_of_solvable`); another one is a function in a module of your own, named in full.
Columns are those of rows.csv, and what `dore.report.frame` adds (solved, solvable, unsolvable, undecided, optimum).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module

import pandas as pd
from scipy import stats

from dore.errors import InputError
from dore.report import estimates
from dore.report.estimates import Estimate
from dore.report.expressions import numbers

Measure = Callable[..., Estimate]


def measure_named(name: str) -> Measure:
    """A measure of this module, or `package.module.function`.

    Raises:
        InputError: there is no such function.
    """
    module, _, function = name.rpartition(".")
    try:
        found: Measure = getattr(import_module(module or __name__), function)
    except (ImportError, AttributeError):
        raise InputError(f"measure: got {name!r}, want a function of dore.report.measures or module.function") from None
    return found


def percent(rows: pd.DataFrame, of: str) -> Estimate:
    """The percentage of the rows where a condition holds, with Wilson's interval."""
    return estimates.proportion(int(numbers(rows, of).sum()), len(rows)).scaled(100)


def counted(rows: pd.DataFrame, of: str) -> Estimate:
    """As `percent`, shown with its counts: `40 of 50 [66.9, 88.8] %`; a row without a value does not count."""
    known = numbers(rows, of).dropna()
    found = estimates.proportion(int(known.sum()), len(known)).scaled(100)
    return replace(found, text=f"{known.sum():.0f} of {len(known)} [{found.low:.1f}, {found.high:.1f}] %")


def over_strata(rows: pd.DataFrame, of: str) -> Estimate:
    """The mean percentage over the benchmark's strata (optimum x density x layout x reach), each weighing the same."""
    strata = numbers(rows, of).groupby([rows[key] for key in ("reach", "layout", "density", "stratum")])
    return estimates.mean_of_shares(strata.sum(), strata.count()).scaled(100)


def lacking(rows: pd.DataFrame, of: str) -> Estimate:
    """How many rows do not fulfil a condition, shown with how many there are: `2 of 50`."""
    missed = len(rows) - int(numbers(rows, of).sum())
    return Estimate(len(rows), missed, text=f"{missed} of {len(rows)}")


def words(rows: pd.DataFrame, of: str) -> Estimate:
    """Every value of a column, as text."""
    return Estimate(len(rows), text="/".join(sorted(set(rows[of]))))


def solved_of_solvable(rows: pd.DataFrame) -> Estimate:
    """The percentage that is solved, of the instances that some planner solves."""
    return estimates.proportion(int(rows.solved.sum()), int(rows.solvable.sum())).scaled(100)


def solved_of_decided(rows: pd.DataFrame) -> Estimate:
    """As `solved_of_solvable`, but nan where an instance is neither solved nor proved unsolvable."""
    return Estimate(int(rows.solvable.sum())) if rows.undecided.any() else solved_of_solvable(rows)


def mean(rows: pd.DataFrame, of: str) -> Estimate:
    """The mean, with its standard deviation and t interval."""
    return estimates.sample_mean(numbers(rows, of))


def ratio(rows: pd.DataFrame, of: str, to: str) -> Estimate:
    """The ratio of two means over the same rows; rows where one of them is missing are left out."""
    both = pd.DataFrame({"of": numbers(rows, of), "to": numbers(rows, to)}).dropna()
    return estimates.ratio_of_means(both["of"], both["to"])


def saved(rows: pd.DataFrame, of: str, to: str) -> Estimate:
    """By how many percent the mean of `of` is below that of `to`."""
    found = ratio(rows, of, to)
    # The fewer moves, the more saved: the ends of the interval change places.
    mean, low, high = (100 * (1 - one) for one in (found.mean, found.high, found.low))
    return Estimate(found.n, mean, low=low, high=high)


def difference(rows: pd.DataFrame, of: str, to: str) -> Estimate:
    """The mean of `of` less `to`, row by row, with its t interval; rows where one of them is missing are left out."""
    return estimates.sample_mean((numbers(rows, of) - numbers(rows, to)).dropna())


def paired_points(rows: pd.DataFrame, of: str, to: str) -> Estimate:
    """By how many percentage points a condition holds more often than another one of the same rows."""
    one, other = numbers(rows, of) > 0, numbers(rows, to) > 0
    return estimates.paired_difference(int((one & ~other).sum()), int((other & ~one).sum()), len(rows)).scaled(100)


def over_optimum(rows: pd.DataFrame) -> Estimate:
    """Rearrangements over the proved optimum's, on the instances that both solve."""
    return ratio(rows[rows.solved & rows.optimum.notna()], "moves", "optimum")


def percentiles(rows: pd.DataFrame, of: str) -> Estimate:
    """The median, and as `high` the largest."""
    found = numbers(rows, of)
    return Estimate(int(found.count()), float(found.median()), low=float(found.min()), high=float(found.max()))


def percentile(rows: pd.DataFrame, of: str, to: float) -> Estimate:
    """The `to`-th percentile alone; the 100th is the highest."""
    found = numbers(rows, of)
    return Estimate(int(found.count()), float(found.quantile(to / 100)))


def mean_and_p95(rows: pd.DataFrame, of: str) -> Estimate:
    """The mean, and as `high` the 95th percentile."""
    found = numbers(rows, of)
    return Estimate(int(found.count()), float(found.mean()), high=float(found.quantile(0.95)))


def mean_and_range(rows: pd.DataFrame, of: str) -> Estimate:
    """The mean, the lowest and the highest."""
    return estimates.spread(numbers(rows, of))


def stated(rows: pd.DataFrame, of: str, to: str) -> Estimate:
    """The mean `of` and the upper end `to` of its symmetric interval, as the first row states them."""
    mean, high = float(numbers(rows, of).iloc[0]), float(numbers(rows, to).iloc[0])
    return Estimate(mean=mean, low=2 * mean - high, high=high)


def slope(rows: pd.DataFrame, of: str, to: str) -> Estimate:
    """By how much `of` grows with `to`: the slope of the least squares' line; nan where `to` is always the same."""
    return _line(rows, of, to, "slope")


def intercept(rows: pd.DataFrame, of: str, to: str) -> Estimate:
    """What is left of `of` where `to` is 0, on the least squares' line; nan where `to` is always the same."""
    return _line(rows, of, to, "intercept")


def _line(rows: pd.DataFrame, of: str, to: str, what: str) -> Estimate:
    x, y = numbers(rows, to), numbers(rows, of)
    return Estimate(len(rows), float(getattr(stats.linregress(x, y), what)) if x.nunique() > 1 else math.nan)


def row_count(rows: pd.DataFrame) -> Estimate:
    """How many rows."""
    return Estimate(len(rows), float(len(rows)))


def _alone(reduced: Callable[[pd.Series], float], one_row: bool = False) -> Measure:
    """A number of all rows, without an interval; nan where there are none.

    one_row: it is the value of one of the rows, and so counts as one.
    """

    def measure(rows: pd.DataFrame, of: str) -> Estimate:
        return Estimate(1 if one_row else len(rows), float(reduced(numbers(rows, of))) if len(rows) else math.nan)

    return measure


average, median, deviation, total = map(_alone, (pd.Series.mean, pd.Series.median, pd.Series.std, pd.Series.sum))
"""The mean, the median, the standard deviation and the sum alone."""
share = _alone(lambda values: 100 * values.mean())
"""As `percent`, without an interval."""
rms = _alone(lambda values: (values**2).mean(skipna=False) ** 0.5)
"""The root of the mean square; nan where a value is missing."""
first = _alone(lambda values: values.iloc[0], one_row=True)
last = _alone(lambda values: values.iloc[-1], one_row=True)
"""The values of the first and of the last row."""
highest = _alone(pd.Series.max, one_row=True)
"""The highest value of any row."""
