"""What the paper's Tables 1 to 3 say, as printed. Constants alone; the tables' scripts set ours beside them."""

from __future__ import annotations

import math
from typing import NamedTuple

T95 = {10: 2.262, 20: 2.093}
"""The 97.5 % quantile of Student's t for the means of so many instances (n - 1 degrees of freedom)."""

OBSTACLES = (3, 4, 5, 6, 7, 8, 9)
"""The columns of all three tables: how many obstacles, the target not counted."""
METHODS = ("graph_search", "baseline", "dqn")
"""The rows: the paper's graph-based search, its baseline, and its proposed single DQN."""
TRAINED_UP_TO = 7
"""The DQN saw no more obstacles in training; columns beyond show what transfer learning mends (section 6.1)."""


class Cell(NamedTuple):
    """One cell of a table: the mean, the standard deviation in its brackets, and over how many instances."""

    mean: float
    sd: float
    n: int

    @property
    def half95(self) -> float:
        """Half the 95 % t interval of the mean; the paper prints none, its n and sd give it."""
        return T95[self.n] * self.sd / math.sqrt(self.n)


Row = dict[int, Cell]
"""A method's cells by the number of obstacles."""


def _row(n: int, means: tuple[float, ...], sds: tuple[float, ...]) -> Row:
    return {z: Cell(mean, sd, n) for z, mean, sd in zip(OBSTACLES, means, sds, strict=True)}


TABLE_1_PLANNING_S: dict[str, Row] = {
    "graph_search": _row(20, (1.3, 2.0, 3.0, 3.7, 4.3, 6.5, 8.3), (0.35, 0.71, 0.71, 0.75, 1.75, 2.03, 1.78)),
    "dqn": _row(20, (0.8, 1.1, 1.2, 1.3, 1.5, 1.9, 2.2), (0.08, 0.41, 0.41, 0.40, 0.74, 0.80, 0.70)),
}
"""Table 1, 6 x 6, 20 repetitions: planning time, seconds."""

TABLE_2_REARRANGEMENTS: dict[str, Row] = {
    "baseline": _row(10, (2.2, 2.6, 3.3, 3.7, 4.9, 5.9, 6.7), (0.78, 0.84, 0.67, 0.48, 1.19, 0.99, 0.82)),
    "dqn": _row(10, (1.4, 1.9, 2.2, 2.4, 3.1, 3.6, 4.3), (0.51, 0.73, 0.63, 0.51, 0.99, 0.96, 0.94)),
}
"""Table 2, 3 x 6, 10 repetitions: number of rearrangements."""

TABLE_2_EXECUTION_S: dict[str, Row] = {
    "baseline": _row(
        10,
        (169.9, 193.9, 235.9, 259.9, 331.9, 391.9, 439.9),
        (48.17, 50.52, 43.84, 30.89, 70.40, 56.66, 52.98),
    ),
    "dqn": _row(
        10,
        (120.7, 150.7, 168.7, 180.7, 222.7, 252.7, 294.7),
        (32.06, 42.36, 38.90, 32.27, 61.99, 57.24, 55.23),
    ),
}
"""Table 2, 3 x 6, 10 repetitions: total execution time, planning and the virtual arm's running time, seconds."""

TABLE_3_REARRANGEMENTS: dict[str, Row] = {
    "baseline": _row(10, (2.2, 2.6, 3.2, 3.5, 4.3, 5.2, 5.8), (0.78, 0.84, 0.63, 0.52, 0.67, 1.03, 0.91)),
    "dqn": _row(10, (1.4, 1.9, 2.1, 2.2, 2.5, 3.1, 3.6), (0.51, 0.73, 0.56, 0.42, 0.84, 0.73, 0.69)),
}
"""Table 3, 6 x 6, 10 repetitions: number of rearrangements."""

REARRANGEMENTS: dict[str, dict[str, Row]] = {"3x6": TABLE_2_REARRANGEMENTS, "6x6": TABLE_3_REARRANGEMENTS}
"""Tables 2 and 3 by the name of their layout (`layout=3x6`, `layout=6x6`)."""
