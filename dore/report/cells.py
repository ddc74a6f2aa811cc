"""The cells of a page's tables, as CSV."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from dore.files import atomic_write
from dore.report.rows import read_table

CELL = ("metric", "row", "column", "n", "mean", "sd", "low", "high")
TEXT = "text"
"""A column that a table of cells may have besides: shown instead of the numbers."""


def write_cells(path: Path, cells: pd.DataFrame) -> None:
    """The cells of a page as CSV, to 9 significant digits: more than a page shows, so that both say the same."""
    columns = [*CELL, *([TEXT] if TEXT in cells and cells[TEXT].astype(bool).any() else [])]
    cells = cells[columns].copy()
    cells["n"] = cells["n"].astype("Int64")
    with atomic_write(path) as file:
        cells.to_csv(file, index=False, float_format="%.9g", lineterminator="\n")


def read_cells(path: Path) -> pd.DataFrame:
    """The inverse of `write_cells`, but for the digits.

    Raises:
        InputError: no such file, or not a table of cells.
    """
    cells = read_table(path, CELL, text=("metric", "row", "column", TEXT))
    cells[list(CELL[3:])] = cells[list(CELL[3:])].astype(float)
    return cells
