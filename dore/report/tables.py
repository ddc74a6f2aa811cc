"""The tables that dore-evaluate prints: a study of one folder (conf/study/_evaluation.yaml, _benchmark.yaml, or
_scene.yaml where an arm carried plans out), as plain text."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from dore.files import GROUPS_FILE, ROWS_FILE, conf_dir, read_record
from dore.report.page import lines_of
from dore.report.rows import read_rows
from dore.report.sources import sources_of
from dore.report.study import cells_of


def evaluation_tables(folder: Path) -> str:
    """How often each planner succeeds, how much it moves and how long it takes; each against the last one; over seeds.

    Raises:
        InputError: no rows.csv, or a damaged one.
    """
    columns = read_rows(folder / ROWS_FILE).columns
    name = "_scene" if "outcome" in columns else "_benchmark" if "stratum" in columns else "_evaluation"
    spec: dict[str, Any] = yaml.safe_load((conf_dir() / "study" / f"{name}.yaml").read_text(encoding="utf-8"))
    sources = sources_of(spec, folder, folder)
    rows = sources["rows"].rows
    rows["group"] = rows.planner.replace(read_record(folder / GROUPS_FILE))
    cells = cells_of(spec, sources)
    missing = {"pairs"} if rows.planner.nunique() == 1 else set()
    shown = [table for table in spec["tables"] if table["name"] in set(cells.metric) - missing]
    return "\n\n".join(as_text(lines_of(cells, table)) for table in shown)


def as_text(lines: Sequence[Sequence[str]]) -> str:
    """Columns aligned with spaces, the header first: the first column to the left, the others to the right."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    texts = [
        "  ".join([line[0].ljust(widths[0]), *(cell.rjust(w) for cell, w in zip(line[1:], widths[1:], strict=True))])
        for line in lines
    ]
    rule = "  ".join("-" * width for width in widths)
    return "\n".join(text.rstrip() for text in [texts[0], rule, *texts[1:]])
