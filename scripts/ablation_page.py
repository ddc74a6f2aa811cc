"""The ablations as CSV, Markdown and a figure, made from the files of runs alone.

python -m scripts.ablation_page FOLDER REPORT: FOLDER holds what scripts/ablation.sh has made; REPORT.csv, REPORT.md and
REPORT.png are written.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from statistics import fmean

from dore.report.intervals import UNKNOWN
from dore.report.measures import as_markdown
from scripts.ablation_figure import draw
from scripts.ablation_runs import BASES, NONE, Variant, read_variants
from scripts.entry_tables import spread, table, write_csv
from scripts.learning_curves import reached
from scripts.paper_entries import Entry, Metric, point
from scripts.report_files import Report, page_main

WANTED = 0.95
END, GAIN, MOVES, EPISODES, SECONDS = (
    "IPT at the end (%)",
    "less unchanged",
    "rearrangements at the end",
    f"episodes to {100 * WANTED:g} % IPT",
    f"seconds to {100 * WANTED:g} % IPT",
)
COLUMNS = (END, GAIN, MOVES, EPISODES, SECONDS)


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the three files; the exit code."""
    return page_main("ablation_page", __doc__, _report, arguments)


def _report(folder: Path, name: str) -> Report:
    variants = read_variants(folder)
    metrics = metrics_of(variants)
    return Report(
        partial(write_csv, metrics=metrics), lambda path: draw(path, variants), _page(variants, metrics, name)
    )


def metrics_of(variants: Sequence[Variant]) -> list[Metric]:
    """A table a base."""
    note = (
        "Mean (sd) [lowest, highest] over seeds. The last IPT of the run, and how much better it is than without the "
        "change, in points; the mean rearrangements over what that IPT solved; the first IPT at or above 95 %, over "
        "the seeds that reach it. A dash: none does."
    )
    return [
        Metric(f"from the {base} form", note, entries, digits=4)
        for base in BASES
        if (entries := [entry for one in variants if one.base == base for entry in _entries(one, variants)])
    ]


def _entries(one: Variant, variants: Sequence[Variant]) -> list[Entry]:
    row = f"{one.structure}: {one.change if one.change != NONE else 'unchanged'}"
    (unchanged,) = [
        other for other in variants if (other.base, other.structure, other.change) == (one.base, one.structure, NONE)
    ]
    ends = [100 * tests[-1].success for tests in one.tests if tests]
    before = [100 * tests[-1].success for tests in unchanged.tests if tests]
    firsts = [first for tests in one.tests if (first := reached(tests, WANTED))]
    entries = [spread(row, END, ends)]
    if one.change != NONE and ends and before:
        entries.append(point(row, GAIN, fmean(ends) - fmean(before), len(ends)))
    moves = [tests[-1].rearrangements for tests in one.tests if tests]
    if not any(map(math.isnan, moves)):
        entries.append(spread(row, MOVES, moves))
    if not firsts:
        return [*entries, Entry(row, EPISODES, 0, UNKNOWN), Entry(row, SECONDS, 0, UNKNOWN)]
    return [
        *entries,
        spread(row, EPISODES, [first.episodes for first in firsts]),
        spread(row, SECONDS, [first.seconds for first in firsts]),
    ]


def _page(variants: Sequence[Variant], metrics: Sequence[Metric], name: str) -> list[str]:
    """The Markdown, line by line."""
    configs = [cfg for one in variants for cfg in one.configs]
    abouts = [about for one in variants for about in one.abouts]
    minutes = _all(cfg.training.max_minutes for cfg in configs)
    seeds = _all(cfg.seed for cfg in configs)
    commits = _all(about["commit"] for about in abouts)
    torch = _all(about["versions"]["torch"] for about in abouts)
    load = ", ".join(f"{load:.2f}" for load in os.getloadavg())
    lines = [
        "# Ablations on 6 x 6, 3-8 obstacles: one key at a time",
        "",
        f"`scripts/ablation.sh`, commit {commits}, torch {torch}, seeds {seeds}, {minutes} minutes a run. Load of the "
        f"machine when this page was made from the runs' files: {load}.",
        "",
        "The tests are those of training, on the validation split; the test split stays unseen. `improved`: the "
        "default agent (`experiment=ablation/improved`); `literal`: the literal runs' numbers, three of them made "
        "smaller so that something is learned within the minutes (conf/experiment/ablation/literal.yaml). The changes:",
        "",
        *(
            f"- {one.base}, {one.structure}, {one.change}: {', '.join(f'`{key}`' for key in one.changed)}"
            for one in variants
            if one.change != NONE
        ),
        "",
        f"![IPT success at the end of each run, a row a change]({name}.png)",
    ]
    for metric in metrics:
        title = f"## {metric.name[0].upper()}{metric.name[1:]}"
        lines += ["", title, "", metric.note, "", as_markdown(table(metric, COLUMNS, "change"))]
    return lines


def _all(values: Iterable[object]) -> str:
    return ", ".join(sorted({str(value) for value in values}))


if __name__ == "__main__":
    sys.exit(main())
