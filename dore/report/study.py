"""From a study's file and its runs to cells: what is measured of which rows, and where in which table it stands."""

from __future__ import annotations

import string
from collections.abc import Iterator, Mapping
from dataclasses import astuple
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from dore.errors import InputError
from dore.files import conf_dir
from dore.report import estimates, frame, measures
from dore.report.estimates import Estimate
from dore.report.frame import CELL, TEXT, Source

Spec = Mapping[str, Any]
MADE_FROM = ("evaluations", "trainings", "tables")


def sources_of(spec: Spec, root: Path, results: Path) -> dict[str, Source]:
    """The data that a study's `sources` name: runs below `root`, tables below `results`.

    Raises:
        InputError: a source of no known kind, a damaged file, or an expression that does not fit.
    """
    found = {}
    for name, source in spec.get("sources", {}).items():
        kinds = [kind for kind in MADE_FROM if kind in source]
        if len(kinds) != 1:
            raise InputError(f"sources.{name}: got {', '.join(source)}, want one of {', '.join(MADE_FROM)}")
        where = results if kinds == ["tables"] else root
        given = {key: source[key] for key in ("same", "keep") if key in source}
        made: Source = getattr(frame, kinds[0])(where, source[kinds[0]], **given)
        found[name] = Source(_prepared(f"sources.{name}", source, made.rows), made.runs)
    return found


def _prepared(name: str, source: Spec, rows: pd.DataFrame) -> pd.DataFrame:
    """The rows with the columns that a source defines, in its order."""
    if rows.empty:
        return rows
    for column, renamed in source.get("rename", {}).items():
        rows[column] = rows[column].replace(dict(renamed))
    for column, expression in source.get("define", {}).items():
        rows[column] = _evaluated(f"{name}.define.{column}", rows, expression)
    if "paper" in source:
        rows = _beside_paper(rows, source["paper"])
    if "where" in source:
        rows = _chosen(f"{name}.where", rows, source["where"])
    for column, condition in source.get("all_solved", {}).items():
        among = rows.solved | ~_evaluated(f"{name}.all_solved", rows, condition).astype(bool)
        rows[column] = among.groupby([rows[key] for key in (*source["same"], "instance")]).transform("all")
    for column, order in reversed(source.get("order", {}).items()):
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
    every = frame.read_table(path, ("n", "mean", "sd"), text=("table", "method", "column"))
    if name not in set(every.table):
        raise InputError(f"paper: got {name!r}, want one of {', '.join(every.table.unique())}")
    return every[every.table == name]


def _evaluated(name: str, rows: pd.DataFrame, expression: str) -> pd.Series:
    try:
        found: pd.Series = rows.eval(expression, engine="python")
    except Exception as error:  # pandas passes on whatever an expression raises.
        raise InputError(f"{name}: {expression!r}: {' '.join(str(error).split())}") from None
    return found


def _chosen(name: str, rows: pd.DataFrame, condition: str) -> pd.DataFrame:
    return rows[_evaluated(name, rows, condition).astype(bool)]


def cells_of(spec: Spec, sources: Mapping[str, Source]) -> pd.DataFrame:
    """Every cell of a study's tables: metric, row, column, n, mean, sd, low, high, and text where a cell is words.

    Raises:
        InputError: a measure or an expression that does not fit its rows.
    """
    records: list[dict[str, Any]] = []
    for table in spec["tables"]:
        made: Cells = {}
        papers: set[str] = set()
        for number, entry in enumerate(table.get("cells", [])):
            where = f"tables.{table['name']}.cells.{number}"
            try:
                new = dict(_paper(entry) if "paper" in entry else _measured(where, entry, sources, made))
            except KeyError as error:
                raise InputError(f"{where}: no {error}") from None
            made |= new
            papers |= {row for row, _ in new} if "paper" in entry else set()
        # The paper's columns that nothing was measured in are left out.
        columns = {column for row, column in made if row not in papers}
        made = {place: one for place, one in made.items() if place[0] not in papers or place[1] in columns}
        if "average" in table:
            made = _averaged(made, table["average"])
        if "group" in table:
            heads = list(dict.fromkeys(row.partition(table["group"])[0] for row, _ in made))
            made = dict(sorted(made.items(), key=lambda one: heads.index(one[0][0].partition(table["group"])[0])))
        records += [_record(table["name"], row, column, one) for (row, column), one in made.items()]
    return pd.DataFrame(records, columns=[*CELL, TEXT])


def _record(metric: str, row: str, column: str, one: Estimate) -> dict[str, Any]:
    return dict(zip((*CELL, TEXT), (metric, row, column, *astuple(one)), strict=True))


Cells = dict[tuple[str, str], Estimate]


def _measured(where: str, entry: Spec, sources: Mapping[str, Source], made: Cells) -> Iterator[tuple[Any, Estimate]]:
    """The cells of one entry: its rows grouped by the names in `row` and `column`, a measure of each group."""
    every = sources[entry["from"]].rows
    if every.empty:
        return
    rows = _chosen(f"{where}.where", every, entry["where"]) if "where" in entry else every
    rows = _joined(where, entry, every, rows)
    row, column, each = entry["row"], entry.get("column", "{column}"), entry.get("each")
    keys = [key for key in _names(row + column) if key != each]
    found: Cells = {}
    for value in _values_of(where, entry, rows):
        for names, group in rows.groupby(keys, sort=False) if keys else [((), rows)]:
            at = dict(zip(keys, names, strict=True)) | ({each: value} if each else {})
            group = group.assign(here=group[each] == value) if each else group
            found[row.format(**at), column.format(**at)] = _related(entry, at, _value(entry, group), made)
    if not _names(row):
        # A column in which nothing fits the condition has a cell too, without a value.
        for at in every[_names(column)].drop_duplicates().to_dict("records"):
            found.setdefault((row, column.format(**at)), Estimate(0))
    yield from found.items()


def _values_of(where: str, entry: Spec, rows: pd.DataFrame) -> list[Any]:
    """The values of the column `each`, which has a row each; one of no meaning where there is none."""
    if "each" not in entry:
        return [None]
    among = _chosen(f"{where}.each_where", rows, entry["each_where"]) if "each_where" in entry else rows
    return sorted(among[entry["each"]].unique())


def _joined(where: str, entry: Spec, every: pd.DataFrame, rows: pd.DataFrame) -> pd.DataFrame:
    """Only the instances that other rows have too; with `base`, their values as columns NAME_base."""
    for key in ("only_with", "base"):
        if key in entry:
            other = _chosen(f"{where}.{key}", every, entry[key])
            at = [*entry["same"], "instance"]
            values = ["moves", "planning_s"] if key == "base" else []
            rows = rows.merge(other[[*at, *values]], on=at, suffixes=("", "_base"))
    return rows


def _value(entry: Spec, group: pd.DataFrame) -> Estimate:
    measure = measures.named(entry["measure"])
    given = {key: entry[key] for key in ("of", "to") if key in entry}
    if over := entry.get("over"):
        each = [measure(one, **given) for _, one in group.groupby(over, sort=False)]
        found = estimates.spread([one.mean for one in each])
    else:
        found = measure(group, **given)
    return found.scaled(entry["scale"]) if "scale" in entry else found


def _related(entry: Spec, at: Spec, found: Estimate, made: Cells) -> Estimate:
    """A cell as it is, or divided by, or less, another cell of the same table."""
    for key in ("over_cell", "less_cell"):
        if key in entry:
            other = made.get(tuple(one.format(**at) for one in entry[key]), Estimate())
            return found.over(other.mean) if key == "over_cell" else Estimate(found.n, found.mean - other.mean)
    return found


def _averaged(made: Cells, column: str) -> Cells:
    """With the mean over the columns as one more column of each row."""
    found = dict(made)
    for row in dict.fromkeys(row for row, _ in made):
        mine = [estimate for (name, _), estimate in made.items() if name == row]
        mean = estimates.mean_of(mine)
        found[row, column] = Estimate(mean.n, mean.mean, low=mean.low, high=mean.high)
    return found


def _paper(entry: Spec) -> Iterator[tuple[Any, Estimate]]:
    """The paper's own cells of a table in conf/study/paper.csv, or an expression over its rows."""
    table = paper_table(entry["paper"])
    if "value" in entry:
        wide = table.pivot(index="column", columns="method", values="mean")
        wide["value"] = wide.eval(entry["value"])
        for one in table.drop_duplicates("column").itertuples():
            yield (entry["row"], one.column), Estimate(one.n, wide.value[one.column])
        return
    for method, row in entry["rows"].items():
        for one in table[table.method == method].itertuples():
            yield (row, one.column), Estimate(one.n, one.mean, one.sd)


def _names(template: str) -> list[str]:
    return [name for _, name, _, _ in string.Formatter().parse(template) if name]


def facts_of(spec: Spec, sources: Mapping[str, Source]) -> dict[str, Any]:
    """What the page's prose needs to know of the runs: commits, seeds, and what else the study's `facts` name."""
    runs = [source.runs for source in sources.values() if not source.runs.empty]
    every = pd.concat(runs, ignore_index=True) if runs else pd.DataFrame()
    found: dict[str, Any] = {
        "commit": _unique(every, "about.commit"),
        "torch": _unique(every, "about.versions.torch"),
    }
    for name, fact in spec.get("facts", {}).items():
        source = sources[fact["from"]]
        if "run" in fact:
            found[name] = _unique(source.runs, fact["run"])
            continue
        if "changes" in fact:
            found[name] = _changes(source.runs, fact)
            continue
        rows = _chosen(f"facts.{name}", source.rows, fact["where"]) if "where" in fact else source.rows
        if "by" in fact:
            found[name] = "-".join(map(str, sorted(set(rows.groupby(fact["by"]).size()))))
        else:
            found[name] = len(rows)
    return found


def _changes(runs: pd.DataFrame, fact: Spec) -> list[str]:
    """For each run what its config sets differently than the run that is like it but for `from_run`.

    Raises:
        InputError: there is no such run.
    """
    if runs.empty:
        return []
    names, plain = _names(fact["changes"]), fact["from_run"]
    keys = [key for key in runs if key.startswith(tuple(f"config.{one}." for one in fact["keys"]))]
    found = []
    for at, group in runs.groupby(names, sort=True):
        one = dict(zip(names, at, strict=True))
        base = runs[(runs[names] == pd.Series(one | plain)).all(axis=1)]
        if base.empty:
            raise InputError(f"{fact['changes'].format(**one)}: no run to compare it with ({plain})")
        was, now = base.iloc[0], group.iloc[0]
        changed = [key for key in keys if str(was[key]) != str(now[key]) and not key.startswith("config.training.max_")]
        shown = [f"`{key.removeprefix('config.')}: {_shown(was[key])} -> {_shown(now[key])}`" for key in changed]
        found += [f"{fact['changes'].format(**one)}: {', '.join(shown)}"] if shown else []
    return found


def _shown(value: Any) -> str:
    """A config's value; a dash where the config has none."""
    return "-" if isinstance(value, float) and value != value else str(value)


def _unique(runs: pd.DataFrame, key: str) -> str:
    """Every value of a column, in order, as one text."""
    values = runs[key].dropna().unique() if key in runs else []
    return ", ".join(sorted({f"{value:g}" if isinstance(value, float) else str(value) for value in values}))
