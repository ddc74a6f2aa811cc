"""What a sweep of trainings leaves: summary.csv, a table over seeds, and learning curves with bands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from dore.app.sweep import JobResult
from dore.draw.style import SERIES
from dore.files import atomic_write, conf_dir, read_done
from dore.report import plots
from dore.report.frame import Source
from dore.report.page import lines_of
from dore.report.panels import COLOURS
from dore.report.sources import sources_of
from dore.report.study import cells_of
from dore.report.tables import as_text

SUMMARY_FILE = "summary.csv"
RESULTS = ("stop_reason", "best_success", "rearrangements", "episodes", "updates", "env_steps", "seconds")


def summarise(folder: Path, ended: Sequence[JobResult]) -> str:
    """Write summary.csv, a row for each job, and the learning curves; the table over seeds, as text.

    Args:
        folder: the sweep's. ended: its jobs, of which one is done at least.
    """
    jobs = _jobs(ended)
    with atomic_write(folder / SUMMARY_FILE) as file:
        jobs.drop(columns="group").to_csv(file, index=False, lineterminator="\n")
    spec: dict[str, Any] = yaml.safe_load((conf_dir() / "study" / "_sweep.yaml").read_text(encoding="utf-8"))
    curves = sources_of(spec, folder, folder)["curves"]
    groups = dict(zip(jobs.job, jobs.group, strict=True))
    rows = curves.rows[curves.rows.job.isin(list(groups))] if len(curves.rows) else curves.rows
    sources = {"jobs": Source(jobs[jobs.code == 0]), "curves": replace(curves, rows=rows)}
    cells = cells_of(spec, sources)
    (figure,) = spec["figures"]
    if "episodes" in rows:
        _draw(folder / figure["file"], figure, sources["curves"], groups)
    made = f"{SUMMARY_FILE} and {figure['file']} are in {folder}"
    return "\n".join([as_text(lines_of(cells, spec["tables"][0])), made])


def _jobs(ended: Sequence[JobResult]) -> pd.DataFrame:
    """A row for each job: what was swept, and how it ended."""
    given = [dict(one.lstrip("+~").partition("=")[::2] for one in job.overrides) for job in ended]
    every = dict.fromkeys(key for one in given for key in one)
    swept = [key for key in every if len({one.get(key) for one in given}) > 1]
    rows = []
    for job, values in zip(ended, given, strict=True):
        mine = {key: values.get(key, "") for key in swept}
        done = read_done(Path(job.folder)) if job.code == 0 else {}
        group = ", ".join(f"{key}={value}" for key, value in mine.items() if key != "seed") or "all"
        ends = {"code": job.code, **{name: done.get(name) for name in RESULTS}, "message": job.message}
        rows.append({"job": Path(job.folder).name, "group": group, **mine, **ends})
    return pd.DataFrame(rows)


def _draw(path: Path, figure: dict[str, Any], curves: Source, groups: dict[str, str]) -> None:
    """A curve for each group, in one panel while there are colours enough, else in a panel each."""
    rows = curves.rows.assign(group=curves.rows.job.map(groups))
    names = list(dict.fromkeys(rows.group))
    colours = {value: name for name, value in COLOURS.items()}
    crowded = len(names) > len(SERIES)
    series = [
        {
            "from": "curves",
            "where": f"group == {name!r}",
            "label": "a group of runs" if crowded else name,
            "colour": colours[SERIES[0 if crowded else number]],
            "over": "job",
        }
        for number, name in enumerate(names)
    ]
    drawn = replace(curves, rows=rows.assign(panel=rows.group if crowded else ""))
    plots.draw(path, {**figure, "series": series}, pd.DataFrame(), {"curves": drawn})
