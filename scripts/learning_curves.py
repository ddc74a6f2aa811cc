"""The intermediate performance tests (IPT) of runs, read from their metrics.csv: how soon a success is reached."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dore.app.run_folder import METRICS
from dore.errors import InputError

Array = np.ndarray


@dataclass(frozen=True)
class Ipt:
    """One IPT: after how many episodes, seconds and updates, and the share that was solved, by how many moves."""

    episodes: int
    seconds: float
    success: float
    rearrangements: float = math.nan
    updates: int = 0


def read_tests(run: Path) -> list[Ipt]:
    """The IPTs of a run, in their order.

    Raises:
        InputError: no metrics.csv, or one that cannot be read.
    """
    path = run / METRICS
    try:
        with path.open(encoding="utf-8", newline="") as file:
            return [
                Ipt(
                    int(row["episodes"]),
                    float(row["seconds"]),
                    float(row["success"]),
                    float(row["rearrangements"] or math.nan),
                    int(row["updates"]),
                )
                for row in csv.DictReader(file)
                if row["success"]
            ]
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: damaged ({error})") from None


def reached(tests: Sequence[Ipt], success: float) -> Ipt | None:
    """The first test at or above `success`, if there is one."""
    return next((one for one in tests if one.success >= success), None)


def band(runs: Sequence[Sequence[Ipt]]) -> tuple[Array, Array, Array, Array]:
    """Episodes, and the lowest, mean and highest success of several runs there, as far as all of them go.

    Tests fall on different episodes in each run; between two tests success is taken as a straight line.
    """
    curves = [tests for tests in runs if tests]
    if not curves:
        return (np.empty(0),) * 4
    first, last = max(tests[0].episodes for tests in curves), min(tests[-1].episodes for tests in curves)
    at = sorted({one.episodes for tests in curves for one in tests if first <= one.episodes <= last} | {last})
    values = np.array(
        [np.interp(at, [one.episodes for one in tests], [one.success for one in tests]) for tests in curves]
    )
    return np.array(at), values.min(0), values.mean(0), values.max(0)
