"""Tables 1 to 3 as CSV, Markdown and a figure, made from the files of runs alone.

python -m scripts.paper_table {1,2,3} FOLDER REPORT: FOLDER holds what scripts/tableN.sh has made; REPORT.csv,
REPORT.md and REPORT.png are written.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from dore.report.tables import Table, as_markdown
from scripts.entry_tables import cell, write_csv
from scripts.paper_entries import ALL, Metric
from scripts.paper_figure import draw
from scripts.paper_metrics import MOVES, SOLVED, TIME, table_1, table_2_or_3
from scripts.paper_runs import Runs, read_runs
from scripts.report_files import Report, write_report

TITLES = {1: "planning time", 2: "rearrangements", 3: "rearrangements"}
DRAWN = {1: (TIME,), 2: (MOVES, SOLVED), 3: (MOVES, SOLVED)}
NOTES = {
    1: "Under `reach=paper_fit`, Tables 2 and 3's, the graph search spends its whole budget; hence another reach here.",
    2: "The paper's total execution time is beside the simulated arm's on [execution_time.md](execution_time.md).",
    3: "",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the three files; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("table", type=int, choices=(1, 2, 3))
    parser.add_argument("folder", type=Path)
    parser.add_argument("report", type=Path)
    chosen = parser.parse_args(arguments)
    make = partial(_report, chosen.table, chosen.folder, chosen.report.name)
    return write_report("paper_table", chosen.report, make)


def _report(table: int, folder: Path, name: str) -> Report:
    runs = read_runs(folder)
    layout = runs.world.layout
    metrics = table_1(runs.columns) if table == 1 else table_2_or_3(runs.columns, f"{layout.rows}x{layout.cols}")
    drawn = [one for one in metrics if one.name in DRAWN[table]]
    return Report(
        partial(write_csv, metrics=metrics), lambda path: draw(path, drawn), _page(table, runs, metrics, name)
    )


def _page(table: int, runs: Runs, metrics: Sequence[Metric], name: str) -> list[str]:
    """The Markdown, line by line."""
    world = runs.world
    size = f"{world.layout.rows} x {world.layout.cols}"
    lines = [
        f"# Table {table}: {TITLES[table]} on {size}, {min(runs.columns)}-{max(runs.columns)} obstacles",
        "",
        f"`scripts/table{table}.sh`, commit {', '.join(runs.commits)}, seed {world.instances.seed} of the instances, "
        f"torch {', '.join(runs.torch)}, {world.threads} thread(s), timing={world.timing}. Load of the machine when "
        f"this page was made from the runs' files: {', '.join(f'{load:.2f}' for load in os.getloadavg())}.",
        "",
        f"{_instances(runs)}, of the {world.split} split; clearance {world.reach.clearance_m:g} m, half fan "
        f"{world.reach.half_fan_deg:g} deg. {_budgets(runs)} {NOTES[table]}".strip(),
        "",
        *(f"- {_trained(runs, model)}" for model in runs.trained),
        "",
        f"![{TITLES[table].capitalize()} over the number of obstacles]({name}.png)",
    ]
    for metric in metrics:
        lines += ["", f"## {metric.name[0].upper()}{metric.name[1:]}", "", metric.note, "", as_markdown(_table(metric))]
    return lines


def _instances(runs: Runs) -> str:
    counts = {len({row.instance for row in rows}) for rows in runs.columns.values()}
    return f"{'-'.join(str(count) for count in sorted({min(counts), max(counts)}))} instances a column"


def _budgets(runs: Runs) -> str:
    """After how long the planners that watch the clock give up."""
    budgets = {name: planner.get("max_seconds") for name, planner in runs.world.planners.items()}
    told = ", ".join(f"{name} {seconds:g} s" for name, seconds in budgets.items() if seconds is not None)
    return f"An instance is given up after: {told}."


def _trained(runs: Runs, model: str) -> str:
    """What a model is, in a line."""
    done, cfg = runs.trained[model], runs.training[model]
    obstacles = f"{cfg.instances.min_obstacles}-{cfg.instances.max_obstacles} obstacles"
    return (
        f"`{model}` DQN: trained with {obstacles}, seed {cfg.seed}, {done['seconds']:.0f} s, "
        f"{done['episodes']:,} episodes, {done['updates']:,} updates; best IPT {100 * done['best_success']:.1f} %."
    )


def _table(metric: Metric) -> Table:
    """Rows of the metric over its columns. One line says n where all rows of ours share it, else each cell does."""
    columns = list(dict.fromkeys(entry.column for entry in metric.entries))
    columns = sorted((one for one in columns if one != ALL), key=int) + [ALL] * (ALL in columns)
    cells = {(entry.row, entry.column): entry for entry in metric.entries}
    ours = {row for row, _ in cells if not row.startswith("paper")}
    counts = {
        column: sorted({cells[row, column].n or 0 for row in ours if (row, column) in cells}) for column in columns
    }
    shared = all(len(count) == 1 for count in counts.values())
    table = [["obstacles", *columns]]
    if shared:
        table.append(["n", *(str(count[0]) for count in counts.values())])
    for row in dict.fromkeys(entry.row for entry in metric.entries):
        found = [cells.get((row, column)) for column in columns]
        table.append([row, *("" if one is None else cell(one, metric.digits, not shared) for one in found)])
    return table


if __name__ == "__main__":
    sys.exit(main())
