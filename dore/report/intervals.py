"""Estimates with their 95 % intervals, from the standard library alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist, fmean, quantiles, stdev

Z95 = NormalDist().inv_cdf(0.975)


@dataclass(frozen=True)
class Interval:
    """An estimate and its 95 % interval; the ends are nan where there are too few values."""

    value: float
    low: float
    high: float


UNKNOWN = Interval(math.nan, math.nan, math.nan)
"""What cannot be told."""


def wilson(successes: int, trials: int) -> Interval:
    """A share and its 95 % Wilson score interval; nan without trials."""
    if trials == 0:
        return Interval(math.nan, math.nan, math.nan)
    share, z2 = successes / trials, Z95**2
    centre = (share + z2 / (2 * trials)) / (1 + z2 / trials)
    half = Z95 * math.sqrt(share * (1 - share) / trials + z2 / (4 * trials**2)) / (1 + z2 / trials)
    # The ends are 0 and 1 there, and not what rounding makes of them.
    low, high = 0.0 if successes == 0 else centre - half, 1.0 if successes == trials else centre + half
    return Interval(share, low, high)


def mean_interval(values: Sequence[float]) -> Interval:
    """The mean and its 95 % t interval; the ends are nan below 4 values."""
    if not values:
        return Interval(math.nan, math.nan, math.nan)
    mean = fmean(values)
    if len(values) < 4:
        return Interval(mean, math.nan, math.nan)
    half = _t95(len(values) - 1) * stdev(values) / math.sqrt(len(values))
    return Interval(mean, mean - half, mean + half)


def ratio_interval(values: Sequence[float], base: Sequence[float]) -> Interval:
    """The mean of `values` over the mean of `base`, pair by pair, and its 95 % interval; nan where `base` sums to 0.

    Source: the ratio estimator (Cochran, Sampling Techniques, 3rd ed., section 6.4): the spread is that of
    value - ratio x base, so values that go with their base make it narrow. The ends are nan below 4 pairs.
    """
    if not sum(base):
        return UNKNOWN
    ratio = sum(values) / sum(base)
    off = mean_interval([value - ratio * under for value, under in zip(values, base, strict=True)])
    return Interval(ratio, ratio + off.low / fmean(base), ratio + off.high / fmean(base))


def percentile(values: Sequence[float], percent: int) -> float:
    """The percentile with linear interpolation between values; nan without values."""
    if len(values) < 2:
        return values[0] if values else math.nan
    return quantiles(values, n=100, method="inclusive")[percent - 1]


def _t95(freedom: int) -> float:
    """The 97.5 % quantile of Student's t, by Cornish and Fisher's series; within 1 % from 3 degrees on."""
    z, v = Z95, freedom
    return (
        z
        + (z**3 + z) / (4 * v)
        + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * v**2)
        + (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / (384 * v**3)
    )
