"""The rows of a measuring program: any columns, in a rows.csv with an about.json beside it."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pandas as pd

from dore.errors import InputError
from dore.files import ABOUT_FILE, ROWS_FILE, atomic_write, commit, write_record


def write_measurements(folder: Path, rows: Sequence[Mapping[str, Any]] | pd.DataFrame, /, **about: Any) -> None:
    """Write a program's rows to a folder, and what they were measured with.

    Args:
        rows: one or more, all with the same names; None where there is no value.
        about: what a page says of them besides commit, versions, machine and load.

    Raises:
        InputError: no rows.
    """
    if not len(rows):
        raise InputError(f"{folder}: got no rows, want one or more")
    folder.mkdir(parents=True, exist_ok=True)
    known = {"commit": commit(), "versions": {"torch": version("torch")}, "machine": platform.machine()}
    load = {"cores": os.cpu_count(), "load": f"{os.getloadavg()[0]:.2f}"}
    write_record(folder / ABOUT_FILE, {**known, **load, **about})
    with atomic_write(folder / ROWS_FILE) as file:
        pd.DataFrame(rows).to_csv(file, index=False, lineterminator="\n")
