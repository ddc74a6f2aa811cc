"""Estimates with their 95 % intervals: shares, means, ratios and spreads (scipy)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

CONFIDENCE = 0.95
FEWEST = 4
"""Fewer values than this have no interval: Student's t would say little else than how few they are."""


@dataclass(frozen=True)
class Estimate:
    """A value over `n` observations. sd: their standard deviation. low, high: an interval; nan where there is none."""

    n: float = math.nan
    mean: float = math.nan
    sd: float = math.nan
    low: float = math.nan
    high: float = math.nan
    text: str = ""

    def scaled(self, scale: float) -> Estimate:
        """In another unit."""
        return replace(self, mean=scale * self.mean, sd=scale * self.sd, low=scale * self.low, high=scale * self.high)

    def over(self, divisor: float) -> Estimate:
        """Its value alone over a number, without an interval."""
        return Estimate(self.n, self.mean / divisor if divisor else math.nan)


def proportion(hits: int, trials: int) -> Estimate:
    """A share of 1 with its Wilson interval; nan without trials."""
    if not trials:
        return Estimate(0)
    interval = stats.binomtest(int(hits), int(trials)).proportion_ci(CONFIDENCE, method="wilson")
    # Rounding would leave the ends of "none" and "all" a hair away from 0 and 1.
    low, high = 0.0 if hits == 0 else float(interval.low), 1.0 if hits == trials else float(interval.high)
    return Estimate(trials, hits / trials, low=low, high=high)


def paired_difference(ahead: int, behind: int, pairs: int) -> Estimate:
    """A share less another one of the same cases. ahead, behind: cases in which only the one, or the other, counts.

    Source of the interval, which has a width also where no case differs: Bonett and Price, Journal of Educational and
    Behavioral Statistics 37 (2012), 479-488.
    """
    if not pairs:
        return Estimate(0)
    up, down = ((count + 1) / (pairs + 2) for count in (ahead, behind))
    half = float(stats.norm.ppf((1 + CONFIDENCE) / 2)) * math.sqrt((up + down - (up - down) ** 2) / (pairs + 2))
    low, high = max(-1.0, up - down - half), min(1.0, up - down + half)
    return Estimate(pairs, (ahead - behind) / pairs, low=low, high=high)


def sample_mean(values: ArrayLike) -> Estimate:
    """The mean, the standard deviation, and the t interval of the mean; no interval below `FEWEST` values."""
    values = np.asarray(values, float)
    if not len(values):
        return Estimate(0)
    centre, sd = float(values.mean()), float(values.std(ddof=1)) if len(values) > 1 else math.nan
    if len(values) < FEWEST:
        return Estimate(len(values), centre, sd)
    half = float(stats.t.ppf((1 + CONFIDENCE) / 2, len(values) - 1)) * sd / math.sqrt(len(values))
    return Estimate(len(values), centre, sd, centre - half, centre + half)


def mean_of_shares(hits: ArrayLike, trials: ArrayLike) -> Estimate:
    """The mean over strata of each one's share, all of them weighing the same; a normal interval.

    Each share's variance is that of (hits + 2) / (trials + 4), so that a stratum of all or none has one, too.

    Source of this: Agresti and Caffo, The American Statistician 54 (2000), 280-288.
    """
    hits, trials = np.asarray(hits, float), np.asarray(trials, float)
    if not len(trials) or not trials.all():
        return Estimate(0)
    centre, moved = float((hits / trials).mean()), (hits + 2) / (trials + 4)
    sd = math.sqrt(float((moved * (1 - moved) / (trials + 4)).sum())) / len(trials)
    half = float(stats.norm.ppf((1 + CONFIDENCE) / 2)) * sd
    return Estimate(float(trials.sum()), centre, low=max(0.0, centre - half), high=min(1.0, centre + half))


def ratio_of_means(values: ArrayLike, base: ArrayLike) -> Estimate:
    """The mean of `values` over the mean of `base`, pair by pair; nan where `base` sums to 0.

    Source: the ratio estimator (Cochran, Sampling Techniques, 3rd ed., section 6.4): the spread is that of
    value - ratio * base, so values that follow their base make it narrow.
    """
    values, base = np.asarray(values, float), np.asarray(base, float)
    if not base.sum():
        return Estimate(len(values))
    centre = float(values.sum() / base.sum())
    off = sample_mean(values - centre * base)
    return Estimate(
        len(values), centre, low=centre + off.low / float(base.mean()), high=centre + off.high / float(base.mean())
    )


def spread(values: ArrayLike) -> Estimate:
    """The mean of a few runs, their standard deviation, and the lowest and highest of them; nan is left out."""
    every = np.asarray(values, float)
    known = every[~np.isnan(every)]
    if not len(known):
        return Estimate(0)
    sd = float(known.std(ddof=1)) if len(known) > 1 else math.nan
    return Estimate(len(known), float(known.mean()), sd, float(known.min()), float(known.max()))


def mean_of_estimates(estimates: list[Estimate]) -> Estimate:
    """The mean of independent estimates, each with the same weight."""
    half = math.hypot(*((one.high - one.low) / 2 for one in estimates)) / len(estimates)
    centre = sum(one.mean for one in estimates) / len(estimates)
    return Estimate(sum(one.n for one in estimates), centre, low=centre - half, high=centre + half)
