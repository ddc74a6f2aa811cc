"""The generalist's measurements as CSV, Markdown and a figure, made from the files of evaluations alone.

python -m scripts.generalist_page FOLDER REPORT: FOLDER holds what scripts/generalist.sh has made; REPORT.csv, REPORT.md
and REPORT.png are written.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from dore.report.tables import as_markdown
from scripts.entry_tables import table, write_csv
from scripts.generalist_figure import draw
from scripts.generalist_metrics import (
    OF_ALL,
    RATIO,
    REACHES,
    SUCCESS,
    TOGETHER,
    density,
    metrics_of,
)
from scripts.generalist_worlds import SIZED, Evaluations, Known, read_evaluations
from scripts.paper_entries import Metric
from scripts.report_files import Report, page_main

MARK = " \\*"
WORLDS = (
    "layout=8x8 instances=z3-13 reach=wide_hand",
    "layout=6x6 instances=z3-9 reach=wide_hand",
    "layout=3x6 instances=z3-9 reach=wide_hand",
    "layout=7x7 instances=z3-10 reach=paper_fit",
    "layout=3x6 instances=z3-9 reach=paper_fit",
    "layout=6x6 instances=z3-9 reach=paper_fit",
    "layout=3x6 instances=z3-9 reach=panda_slim",
)
"""What the shipped model learned from."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the three files; the exit code."""
    return page_main("generalist_page", __doc__, _report, arguments)


def _report(folder: Path, name: str) -> Report:
    found = read_evaluations(folder, WORLDS)
    metrics = metrics_of(found)
    return Report(
        partial(write_csv, metrics=metrics),
        lambda path: draw(path, found) if found.sized else None,
        _page(found, metrics, name),
    )


def _page(found: Evaluations, metrics: Sequence[Metric], name: str) -> list[str]:
    """The Markdown, line by line."""
    world = found.worlds[0].cfg
    sizes = sorted({len(one.rows["exact"]) for one in found.worlds})
    undecided = sum(len(one.undecided) for one in found.worlds)
    lines = [
        "# One network for all boards: what it never saw",
        "",
        f"`scripts/generalist.sh`, commit {', '.join(found.commits)}, torch {', '.join(found.torch)}, seed "
        f"{world.instances.seed} of the instances, weights `{found.model}`. Load of the machine when this page was "
        f"made from the evaluations' files: {', '.join(f'{load:.2f}' for load in os.getloadavg())}.",
        "",
        f"{'-'.join(map(str, sizes))} instances of each world, of the {world.split} split, nothing trained on them. "
        "`learned`: the network's greedy choices; `guided`: its search; `exact`: the proof. Each is given "
        f"{world.planners.guided.max_seconds:g} s of its own for an instance; {undecided} instances of "
        f"{sum(len(one.rows['exact']) for one in found.worlds)} stay undecided.",
        "",
        f"\\*: the network has learned from this layout, reach and number of obstacles; that is "
        f"{'; '.join(f'`{one}`' for one in WORLDS)} (`conf/experiment/generalist.yaml`). All else it has never seen.",
    ]
    if found.sized:
        lines += ["", f"![Success and rearrangements over the density, a line a size]({name}.png)"]
    titles = {
        SUCCESS: f"{SUCCESS}, reach {SIZED}",
        OF_ALL: f"{OF_ALL}, reach {SIZED}",
        RATIO: f"{RATIO}, reach {SIZED}",
    }
    for metric in metrics:
        if metric.name in (TOGETHER, SUCCESS, OF_ALL, RATIO, REACHES) and metric.entries:
            title = titles.get(metric.name, metric.name)
            lines += ["", f"## {title[0].upper()}{title[1:]}", "", metric.note, "", as_markdown(_cells(metric, found))]
    return lines


def _cells(metric: Metric, found: Evaluations) -> list[list[str]]:
    """A metric's table, with a mark at what the network has learned from."""
    columns = list(dict.fromkeys(entry.column for entry in metric.entries))
    cells = table(metric, columns, "", with_n=metric.name in (TOGETHER, RATIO))
    trained = [world for world in (*found.sized, *found.others) if world.known is Known.TRAINED]
    if metric.name == REACHES:
        rows = {f"{world.reach}, {world.size}, {world.percent} %" for world in trained}
        return [[row[0] + MARK if row[0] in rows else row[0], *row[1:]] for row in cells]
    if metric.name == TOGETHER:
        return cells
    marked = {(world.size, density(world)) for world in trained if world.reach == SIZED}
    for row in cells[1:]:
        size = row[0].rpartition(", ")[0]
        row[1:] = [cell + MARK * ((size, column) in marked) for column, cell in zip(columns, row[1:], strict=True)]
    return cells


if __name__ == "__main__":
    sys.exit(main())
