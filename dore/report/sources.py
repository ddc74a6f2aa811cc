"""The data of a study, prepared as its `sources` say: columns renamed, defined, filtered, put in order."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pandas as pd

from dore.errors import InputError
from dore.files import conf_dir
from dore.report import frame
from dore.report.expressions import chosen, evaluated
from dore.report.frame import Source, Spec
from dore.report.rows import read_table

RUN_SOURCES = ("evaluations", "trainings", "measurements")
"""What a source may be made from, besides the rows that are `kept_in` a file beside the page."""


def sources_of(spec: Spec, root: Path, results: Path) -> dict[str, Source]:
    """The data that a study's `sources` name: runs below `root`, or what is kept of them in `results`.

    Raises:
        InputError: a source of no known kind, a damaged file, or an expression that does not fit.
    """
    found = {}
    for name, source in spec.get("sources", {}).items():
        made = source_of(name, source, root)
        if made.rows.empty and "kept_in" in source:
            made = frame.kept(results, source["kept_in"])
        runs = made.runs
        for column, renamed in source.get("rename", {}).items():
            if column in runs:
                runs[column] = runs[column].replace(dict(renamed))
        rows = _prepared(f"sources.{name}", source, made.rows)
        found[name] = Source(rows, _sorted(runs, source), tuple(source.get("same", ())), made.committed)
    return found


def source_of(name: str, source: Spec, root: Path) -> Source:
    """The data that one source names, as the runs left it; none where it names only what is kept."""
    kinds = [kind for kind in RUN_SOURCES if kind in source]
    if not kinds and "kept_in" in source:
        return Source(pd.DataFrame())
    if len(kinds) != 1:
        raise InputError(f"sources.{name}: got {', '.join(source)}, want one of {', '.join(RUN_SOURCES)}")
    (kind,) = kinds
    more = {"evaluations": ("same", "keep"), "measurements": ("keep",)}.get(kind, ())
    made: Source = getattr(frame, kind)(root, source[kind], **{key: source[key] for key in more if key in source})
    return made


def _prepared(name: str, source: Spec, rows: pd.DataFrame) -> pd.DataFrame:
    """The rows with the columns that a source defines, in its order."""
    if rows.empty:
        return rows
    for column, wanted in source.get("require", {}).items():
        if others := sorted(set(map(str, rows[column])) - {str(wanted)}):
            raise InputError(f"{name}: {column} {', '.join(others)}, want {wanted}")
    for column, renamed in source.get("rename", {}).items():
        rows[column] = rows[column].replace(dict(renamed))
    rows = chosen(name, rows, source).copy()
    for column, expression in source.get("define", {}).items():
        rows[column] = evaluated(f"{name}.define.{column}", rows, expression)
    if "paper" in source:
        rows = _beside_paper(rows, source["paper"])
    for column, condition in source.get("all_solved", {}).items():
        among = rows.solved | ~evaluated(f"{name}.all_solved", rows, condition).astype(bool)
        rows[column] = among.groupby([rows[key] for key in (*source["same"], "instance")]).transform("all")
    return _sorted(rows, source)


def _sorted(rows: pd.DataFrame, source: Spec) -> pd.DataFrame:
    """Rows in a source's `order`, by those of its columns that they have."""
    for column, order in reversed(source.get("order", {}).items()):
        if column in rows:
            rows = rows.sort_values(column, key=partial(_places, order=list(map(str, order))), kind="stable")
    return rows


def _places(values: pd.Series, order: list[str]) -> pd.Series:
    """What to sort a column by: the values of an order first, then the others by themselves."""
    others = sorted(set(values) - set(order), key=lambda one: (isinstance(one, str), one))
    return values.map(lambda one: order.index(str(one)) if str(one) in order else len(order) + others.index(one))


def _beside_paper(rows: pd.DataFrame, wanted: Spec) -> pd.DataFrame:
    """With the paper's number for each row's method and column."""
    table = paper_table(wanted["table"]).rename(columns={"method": wanted["method"], "mean": wanted["as"]})
    return rows.merge(table[[wanted["method"], "column", wanted["as"]]], how="left", on=[wanted["method"], "column"])


def paper_table(name: str) -> pd.DataFrame:
    """One table of the paper, as printed: method, column, n, mean, sd (conf/study/paper.csv)."""
    path = conf_dir() / "study" / "paper.csv"
    every = read_table(path, ("n", "mean", "sd"), text=("table", "method", "column"))
    if name not in set(every.table):
        raise InputError(f"paper: got {name!r}, want one of {', '.join(every.table.unique())}")
    return every[every.table == name]
