"""metrics.csv of a training: one row per test (IPT) and per report of progress, continued when a run is resumed."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

from dore.files import atomic_write


class MetricsLog:
    """Writes metrics.csv row by row, so that a killed run keeps all but its last line.

    Not TorchRL's CSVLogger (0.14): it writes a file for each figure, and cannot drop the rows after a checkpoint.
    """

    def __init__(self, path: Path, columns: Sequence[str], keep_until: int | None = None) -> None:
        """keep_until: the iteration from which a run is resumed; later rows are dropped. None: a new file.

        A new file is made with its first row.
        """
        self.path, self.columns = path, columns
        self.kept = [] if keep_until is None else self._rows_until(keep_until)
        """The rows that are kept from before."""
        if self.kept:
            self._begin(self.kept)
        else:
            path.unlink(missing_ok=True)

    def write(self, row: Mapping[str, object]) -> None:
        """Add a row; None is left empty."""
        if not self.path.exists():
            self._begin([])
        with open(self.path, "a", encoding="utf-8", newline="") as file:
            csv.DictWriter(file, self.columns).writerow(row)

    def _begin(self, rows: Sequence[Mapping[str, object]]) -> None:
        with atomic_write(self.path) as file:
            writer = csv.DictWriter(file, self.columns)
            writer.writeheader()
            writer.writerows(rows)

    def _rows_until(self, iteration: int) -> list[dict[str, str]]:
        if not self.path.exists():
            return []
        with open(self.path, encoding="utf-8", errors="replace", newline="") as file:
            rows = list(csv.DictReader(file))
        return [row for row in rows if (row["iteration"] or "").isdigit() and int(row["iteration"]) <= iteration]
