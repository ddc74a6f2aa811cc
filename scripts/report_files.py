"""The three files of a page: REPORT.csv, REPORT.png and REPORT.md, each whole or not at all."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from dore.errors import InputError, atomic_write
from scripts.entry_tables import write_csv
from scripts.paper_entries import Metric


class Report(NamedTuple):
    """What a page says. draw: writes its picture. lines: its Markdown."""

    metrics: Sequence[Metric]
    draw: Callable[[Path], None]
    lines: Sequence[str]


def write_report(program: str, report: Path, make: Callable[[], Report]) -> int:
    """Write the files of `report`, a path without an ending; the exit code.

    Bad input is one line on stderr and exit code 2, and no file is written.
    """
    try:
        made = make()
        report.parent.mkdir(parents=True, exist_ok=True)
        write_csv(report.with_suffix(".csv"), made.metrics)
        made.draw(report.with_suffix(".png"))
        with atomic_write(report.with_suffix(".md")) as file:
            file.write("\n".join(made.lines) + "\n")
    except InputError as error:
        print(f"{program}: {error}", file=sys.stderr)
        return 2
    print(report.with_suffix(".md"))
    return 0
