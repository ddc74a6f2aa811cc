"""The three files of a page: REPORT.csv, REPORT.png and REPORT.md, each whole or not at all."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from dore.errors import InputError
from dore.files import atomic_write


class Report(NamedTuple):
    """What a page says. write_csv, draw: write its figures and its picture. lines: its Markdown."""

    write_csv: Callable[[Path], None]
    draw: Callable[[Path], None]
    lines: Sequence[str]


def page_main(
    program: str, about: str | None, make: Callable[[Path, str], Report], arguments: Sequence[str] | None
) -> int:
    """`program FOLDER REPORT`, of a page that `make` makes of a folder and the page's name; the exit code."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("folder", type=Path)
    parser.add_argument("report", type=Path)
    chosen = parser.parse_args(arguments)
    return write_report(program, chosen.report, partial(make, chosen.folder, chosen.report.name))


def write_report(program: str, report: Path, make: Callable[[], Report]) -> int:
    """Write the files of `report`, a path without an ending; the exit code.

    Bad input is one line on stderr and exit code 2, and no file is written.
    """
    try:
        made = make()
        report.parent.mkdir(parents=True, exist_ok=True)
        made.write_csv(report.with_suffix(".csv"))
        made.draw(report.with_suffix(".png"))
        with atomic_write(report.with_suffix(".md")) as file:
            file.write("\n".join(made.lines) + "\n")
    except InputError as error:
        print(f"{program}: {error}", file=sys.stderr)
        return 2
    print(report.with_suffix(".md"))
    return 0
