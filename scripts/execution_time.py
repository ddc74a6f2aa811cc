"""Table 2's execution time: simulated seconds of the baseline's and the learned plans, beside the paper's.

python -m scripts.execution_time PAGE BASELINE LEARNED: the two folders are scripts/executions.py's, of the same scenes;
PAGE.md, PAGE.csv and PAGE.png are written.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean, linear_regression

from dore.errors import InputError
from dore.files import atomic_write, commit
from dore.report.tables import Table, as_markdown
from scripts.entry_tables import table, write_csv
from scripts.execution_report import Run, read
from scripts.paper_entries import Entry, Metric, mean, of_paper
from scripts.paper_figure import draw
from scripts.paper_rows import TABLE_2_EXECUTION_S, TABLE_2_REARRANGEMENTS

NAMES = {"baseline": "straight_line", "dqn": "learned (sequential)"}


def main(page: Path, baseline: Path, learned: Path) -> None:
    """Read, compare, write.

    Raises:
        InputError: the folders hold different scenes.
    """
    runs = {"baseline": list(read("straight_line", baseline)), "dqn": list(read("learned", learned))}
    if [(one.obstacles, one.number) for one in runs["baseline"]] != [(o.obstacles, o.number) for o in runs["dqn"]]:
        raise InputError(f"{baseline} and {learned}: not of the same scenes, or one is not finished")
    both = [pair for pair in zip(runs["baseline"], runs["dqn"], strict=True) if all(one.success for one in pair)]
    columns = sorted({one.obstacles for one, _ in both})
    times = Metric("execution time (s)", "", [*of_paper(TABLE_2_EXECUTION_S, columns), *_ours(both, columns)])
    write_csv(page.with_suffix(".csv"), [times])
    draw(page.with_suffix(".png"), [times, Metric("execution time, ours alone (s)", "", _ours(both, columns))])
    with atomic_write(page.with_suffix(".md")) as file:
        file.write("\n".join(_page(page.name, runs, both, times)) + "\n")
    print(f"{page}.md")


def _ours(both: Sequence[tuple[Run, Run]], columns: Sequence[int]) -> list[Entry]:
    return [
        mean(NAMES[method], str(z), [pair[place].simulated_s for pair in both if pair[0].obstacles == z])
        for place, method in enumerate(NAMES)
        for z in columns
    ]


def _page(name: str, runs: dict[str, list[Run]], both: Sequence[tuple[Run, Run]], times: Metric) -> list[str]:
    columns = list(dict.fromkeys(entry.column for entry in times.entries))
    left_out = len(runs["dqn"]) - len(both)
    saved = 1 - fmean(one.simulated_s for _, one in both) / fmean(one.simulated_s for one, _ in both)
    return [
        "# Table 2: execution time on 3 x 6, 3-9 obstacles",
        "",
        f"`scripts/execution_time.sh`, commit {commit()}, load {os.getloadavg()[0]:.2f} when this page was made from "
        "the runs' reports. Simulated seconds from the arm's first motion to the target held up before the grid, open "
        "loop; planning takes milliseconds and is not in them. The first scenes of the test split that both planners "
        "have plans for, under `reach=panda_slim`; `learned` is the model in the package.",
        "",
        f"{len(both)} scenes carried out by both; {left_out} left out, where one was refused or met a fault. The "
        f"learned plans take {100 * saved:.1f} % less time over all columns together; in the paper the mean saving is "
        "30 %.",
        "",
        f"![Execution time over the number of obstacles]({name}.png)",
        "",
        "Mean (sd) and 95 % interval.",
        "",
        as_markdown(table(times, columns, "obstacles")),
        "",
        "## What a move costs",
        "",
        "The slope of seconds over rearrangements, and what is left without any: the target's own retrieval. The "
        "paper's columns lie on lines of 60.0 s a move to a tenth of a second, with 37.9 s (baseline) and 36.7 s (DQN) "
        "besides: a slow arm's, the virtual Jaco's.",
        "",
        as_markdown(_costs(both)),
    ]


def _costs(both: Sequence[tuple[Run, Run]]) -> Table:
    """Least squares over all executions, and over the paper's columns."""
    ours = [(one.moves - 1, one.simulated_s) for pair in both for one in pair]
    paper = [
        (TABLE_2_REARRANGEMENTS[method][z].mean, cell.mean)
        for method, cells in TABLE_2_EXECUTION_S.items()
        for z, cell in cells.items()
    ]
    costs: Table = [["", "s a move", "s for the target"]]
    for name, points in (("paper", paper), ("ours", ours)):
        if len({moves for moves, _ in points}) < 2:
            costs.append([name, "-", "-"])
            continue
        line = linear_regression(*zip(*points, strict=True))
        costs.append([name, f"{line.slope:.1f}", f"{line.intercept:.1f}"])
    return costs


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:4]))
