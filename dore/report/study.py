"""From a study's file and its runs to cells: what is measured of which rows, and where in which table it stands."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Mapping
from dataclasses import astuple
from typing import Any

import pandas as pd

from dore.errors import InputError
from dore.report import estimates, measures
from dore.report.cells import CELL, TEXT
from dore.report.estimates import Estimate
from dore.report.expressions import chosen, names_in
from dore.report.frame import Source, Spec
from dore.report.sources import paper_table


def cells_of(spec: Spec, sources: Mapping[str, Source]) -> pd.DataFrame:
    """Every cell of a study's tables: metric, row, column, n, mean, sd, low, high, and text where a cell is words.

    Raises:
        InputError: a measure or an expression that does not fit its rows.
    """
    records: list[dict[str, Any]] = []
    for table in tables_of(spec, sources):
        made: Cells = {}
        papers: set[str] = set()
        for number, entry in enumerate(table.get("cells", [])):
            where = f"tables.{table['name']}.cells.{number}"
            try:
                new = dict(_entry(where, entry, sources, made))
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
            heads = list(dict.fromkeys(row.rpartition(table["group"])[0] for row, _ in made))
            made = dict(sorted(made.items(), key=lambda one: heads.index(one[0][0].rpartition(table["group"])[0])))
        records += [_record(table["name"], row, column, one) for (row, column), one in made.items()]
    return pd.DataFrame(records, columns=[*CELL, TEXT])


def tables_of(spec: Spec, sources: Mapping[str, Source]) -> list[dict[str, Any]]:
    """A study's tables. One with `split` becomes a table for each value of that column of a source.

    One with `where` has only rows that fulfil that condition, beside those of its cells. One with `all` has a row
    more, in which nothing is grouped by row.
    """
    found: list[dict[str, Any]] = []
    for table in spec["tables"]:
        cells = [one for entry in table.get("cells", []) for one in (entry, *_over_all(entry, table))]
        if "where" in table:
            cells = [_narrowed(one, table["where"]) for one in cells]
        table = {**table, "cells": cells}
        if "split" not in table:
            found.append(table)
            continue
        column = table["split"]["by"]
        for value in sources[table["split"]["from"]].rows[column].unique():
            narrow = [_narrowed(one, f"{column} == {value!r}") for one in cells]
            found.append({**table, "name": value, "cells": narrow})
    return found


def _narrowed(entry: Spec, condition: str) -> Spec:
    """An entry of a table, of fewer rows."""
    return {**entry, "where": f"({condition}) and ({entry['where']})" if "where" in entry else condition}


def _over_all(entry: Spec, table: Spec) -> list[Spec]:
    return [{**entry, "row": table["all"]}] if "all" in table else []


def _record(metric: str, row: str, column: str, one: Estimate) -> dict[str, Any]:
    return dict(zip((*CELL, TEXT), (metric, row, column, *astuple(one)), strict=True))


Cells = dict[tuple[str, str], Estimate]


def _entry(where: str, entry: Spec, sources: Mapping[str, Source], made: Cells) -> Iterator[tuple[Any, Estimate]]:
    """The cells of one entry of a table: the paper's, a quotient of two rows, or measured ones."""
    if "paper" in entry:
        return _paper(entry)
    if "quotient" in entry:
        one, other = (made.get((row, entry["column"]), Estimate()) for row in entry["quotient"])
        return iter([((entry["row"], entry["column"]), Estimate(other.n, one.over(other.mean).mean))])
    if "constant" in entry:
        return iter([((entry["row"], entry["column"]), Estimate(mean=entry["constant"]))])
    return _measured(where, entry, sources, made)


def _measured(where: str, entry: Spec, sources: Mapping[str, Source], made: Cells) -> Iterator[tuple[Any, Estimate]]:
    """The cells of one entry: its rows grouped by the names in `row` and `column`, a measure of each group."""
    every = sources[entry["from"]].rows
    if every.empty:
        return
    rows = chosen(where, every, entry)
    rows = _joined(where, entry, sources[entry["from"]], rows)
    row, column, each = entry["row"], entry.get("column", "{column}"), entry.get("each")
    keys = [key for key in names_in(row + column) if key != each]
    found: Cells = {}
    for value in _values_of(where, entry, rows):
        for names, group in rows.groupby(keys, sort=False) if keys else [((), rows)]:
            at = dict(zip(keys, names, strict=True)) | ({each: value} if each else {})
            group = group.assign(here=group[each] == value) if each else group
            found[row.format(**at), column.format(**at)] = _related(entry, at, _value(entry, group), made)
    if not names_in(row):
        # A column in which nothing fits the condition has a cell too, without a value.
        for at in every[names_in(column)].drop_duplicates().to_dict("records"):
            found.setdefault((row, column.format(**at)), Estimate(0))
    yield from found.items()


def _values_of(where: str, entry: Spec, rows: pd.DataFrame) -> list[Any]:
    """The values of the column `each`, which has a row each; one of no meaning where there is none."""
    if "each" not in entry:
        return [None]
    among = chosen(where, rows, entry, "each_where")
    return sorted(among[entry["each"]].unique())


def _joined(where: str, entry: Spec, source: Source, rows: pd.DataFrame) -> pd.DataFrame:
    """Only the instances that other rows have too; with `base`, what the entry calls NAME_base is their NAME."""
    asked = set(re.findall(r"(\w+)_base\b", f"{entry.get('of')} {entry.get('to')}"))
    for key, names in (("only_with", set()), ("base", asked)):
        if key in entry:
            values = [name for name in rows if name in names]
            other = chosen(where, source.rows, entry, key)
            at = [*source.world, "instance"]
            rows = rows.merge(other[[*at, *values]], on=at, suffixes=("", "_base"))
    return rows


def _value(entry: Spec, group: pd.DataFrame) -> Estimate:
    if group.empty:
        return Estimate(0)
    measure = measures.measure_named(entry["measure"])
    given = {key: entry[key] for key in ("of", "to") if key in entry}
    try:
        inspect.signature(measure).bind(group, **given)
    except TypeError as error:
        raise InputError(f"measure: {entry['measure']} of row {entry['row']!r}: {error}") from None
    if over := entry.get("over"):
        each = [measure(one, **given) for _, one in group.groupby(over, sort=False)]
        return estimates.spread([one.mean for one in each])
    return measure(group, **given)


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
        mean = estimates.mean_of_estimates(mine)
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
