"""Table 4 as CSV, Markdown and a figure, made from the files of runs alone.

python -m scripts.table4_page FOLDER REPORT: FOLDER holds what scripts/table4.sh has made; REPORT.csv, REPORT.md and
REPORT.png are written.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from dore.report.measures import as_markdown
from scripts.entry_tables import table, write_csv
from scripts.paper_entries import Metric
from scripts.report_files import Report, page_main
from scripts.table4_figure import draw, titled
from scripts.table4_metrics import metrics_of
from scripts.table4_runs import Runs, read_runs


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the three files; the exit code."""
    return page_main("table4_page", __doc__, _report, arguments)


def _report(folder: Path, name: str) -> Report:
    runs = read_runs(folder)
    metrics = metrics_of(runs)
    figures = partial(write_csv, metrics=metrics)
    return Report(figures, lambda path: draw(path, runs), _page(runs, metrics, name))


def _page(runs: Runs, metrics: Sequence[Metric], name: str) -> list[str]:
    """The Markdown, line by line."""
    world = next(iter(runs.worlds.values()))
    sizes = sorted({len({row.instance for row in runs.rows[column]["exact"]}) for column in runs.columns})
    seeds = sorted({run.cfg.seed for run in runs.improved.values()})
    lines = [
        "# Table 4: success of both structures, taken literally and improved",
        "",
        f"`scripts/table4.sh`, commit {', '.join(runs.commits)}, torch {', '.join(runs.torch)}, seed "
        f"{world.instances.seed} of the instances, seeds {', '.join(map(str, seeds)) or '-'} of the improved runs. "
        "Load of the machine when this page was made from the runs' files: "
        f"{', '.join(f'{load:.2f}' for load in os.getloadavg())}.",
        "",
        f"{'-'.join(map(str, sizes))} instances a column, of the {world.split} split; clearance "
        f"{world.reach.clearance_m:g} m, half fan {world.reach.half_fan_deg:g} deg. `literal`: Table 5's numbers "
        "(`experiment=paper/table4`), each network on its own column. `improved`: the default agent from scratch on "
        "each column (`experiment=table4`). `generalist`: the one model in the package, for all columns; `guided`: "
        "the search that it leads. A dash: no such run, or none that has ended.",
        "",
        f"![Learning curves: IPT success over episodes, a panel a column]({name}.png)",
    ]
    shown = [titled(column) for column in runs.columns]
    for metric in metrics:
        cells = table(metric, runs.columns, "obstacles")
        cells[0][1:] = shown
        lines += ["", f"## {metric.name[0].upper()}{metric.name[1:]}", "", metric.note, "", as_markdown(cells)]
    return lines


if __name__ == "__main__":
    sys.exit(main())
