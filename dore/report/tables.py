"""The tables that dore-evaluate prints: a study of one folder (conf/study/_evaluation.yaml), as plain text."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from dore.files import GROUPS_FILE, conf_dir, read_record
from dore.report.page import lines_of
from dore.report.sources import sources_of
from dore.report.study import cells_of


def evaluation_tables(folder: Path) -> str:
    """How often each planner succeeds, how much it moves and how long it takes; each against the last one; over seeds.

    Raises:
        InputError: no rows.csv, or a damaged one.
    """
    spec: dict[str, Any] = yaml.safe_load((conf_dir() / "study" / "_evaluation.yaml").read_text(encoding="utf-8"))
    sources = sources_of(spec, folder, folder)
    rows = sources["rows"].rows
    rows["group"] = rows.planner.replace(read_record(folder / GROUPS_FILE))
    cells = cells_of(spec, sources)
    several = spec["tables"] if rows.planner.nunique() > 1 else spec["tables"][:1]
    shown = [table for table in several if table["name"] in set(cells.metric)]
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
