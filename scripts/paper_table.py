"""Tables 1 to 3 as CSV, Markdown and a figure, made from the files of runs alone.

python -m scripts.paper_table {1,2,3} FOLDER REPORT: FOLDER holds what scripts/tableN.sh has made; REPORT.csv,
REPORT.md and REPORT.png are written.
"""

from __future__ import annotations

import argparse
import csv
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from dore.errors import InputError, atomic_write
from dore.tables import Table, as_markdown
from scripts.paper_entries import ALL, Entry, Metric
from scripts.paper_figure import draw
from scripts.paper_metrics import MOVES, SOLVED, TIME, table_1, table_2_or_3
from scripts.paper_runs import Runs, read_runs

TITLES = {1: "planning time", 2: "rearrangements", 3: "rearrangements"}
DRAWN = {1: (TIME,), 2: (MOVES, SOLVED), 3: (MOVES, SOLVED)}
COLUMNS = ("table", "metric", "row", "column", "n", "mean", "sd", "low", "high")
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
    try:
        runs = read_runs(chosen.folder)
        layout = runs.world.layout
        metrics = (
            table_1(runs.columns) if chosen.table == 1 else table_2_or_3(runs.columns, f"{layout.rows}x{layout.cols}")
        )
        chosen.report.parent.mkdir(parents=True, exist_ok=True)
        _write_csv(chosen.report.with_suffix(".csv"), chosen.table, metrics)
        draw(chosen.report.with_suffix(".png"), [one for one in metrics if one.name in DRAWN[chosen.table]])
        with atomic_write(chosen.report.with_suffix(".md")) as file:
            file.write("\n".join(_page(chosen.table, runs, metrics, chosen.report.name)) + "\n")
    except InputError as error:
        print(f"paper_table: {error}", file=sys.stderr)
        return 2
    print(chosen.report.with_suffix(".md"))
    return 0


def _write_csv(path: Path, table: int, metrics: Sequence[Metric]) -> None:
    """A line a cell; what there is none of is left empty."""
    with atomic_write(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for metric in metrics:
            for entry in metric.entries:
                numbers = (entry.value.value, entry.sd, entry.value.low, entry.value.high)
                shown = ["" if math.isnan(number) else f"{number:.6g}" for number in numbers]
                n = "" if entry.n is None else entry.n
                writer.writerow([table, metric.name, entry.row, entry.column, n, *shown])


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
        table.append([row, *("" if one is None else _cell(one, metric.digits, not shared) for one in found)])
    return table


def _cell(entry: Entry, digits: int, with_n: bool) -> str:
    """`mean (sd) [low, high], n`, as far as there is such a thing."""
    if math.isnan(entry.value.value):
        return "-"
    text = _number(entry.value.value, digits)
    if not math.isnan(entry.sd):
        text += f" ({_number(entry.sd, digits)})"
    if not math.isnan(entry.value.low):
        text += f" [{_number(entry.value.low, digits)}, {_number(entry.value.high, digits)}]"
    return f"{text}, n {entry.n}" if with_n and entry.n is not None else text


def _number(value: float, digits: int) -> str:
    """So many significant digits, and no exponent where there are many before the point."""
    return f"{value:,.0f}" if abs(value) >= 10**digits else f"{value:#.{digits}g}".rstrip(".")


if __name__ == "__main__":
    sys.exit(main())
