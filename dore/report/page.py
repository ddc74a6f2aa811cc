"""A page of a study: cells and facts into Markdown, by a Jinja2 template."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jinja2
import pandas as pd

from dore.errors import InputError
from dore.report.cells import TEXT
from dore.report.frame import Source, Spec

PAGE = """\
# {{ study.title }}

{{ head }}
{% for one in study.get('figures', []) %}

![{{ text(one.alt) }}]({{ one.file }})
{% endfor %}
{% for one in study.tables if not one.get('hidden') and one.name in shown %}

{% if one.get('title', one.name) %}
## {{ one.get('title') or one.name[0]|upper ~ one.name[1:] }}

{% endif %}
{% if one.get('note') %}
{{ text(one.note) }}

{% endif %}
{{ table(one.name) }}
{% endfor %}
"""
"""What a page looks like whose study has no `page` of its own."""


def render(spec: Spec, cells: pd.DataFrame, facts: Mapping[str, Any], sources: Mapping[str, Source]) -> str:
    """The page in Markdown.

    Raises:
        InputError: a template that does not fit its cells or facts.
    """
    environment = jinja2.Environment(
        undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )
    view = {
        "study": spec,
        "facts": facts,
        "cells": cells,
        "table": lambda name: table_of(cells, _table(spec, name)),
        "value": lambda *place: _value(cells, *place),
        "rows": lambda name: sources[name].rows,
        "number": significant,
        "shown": set(cells.metric),
    }

    def text(template: str) -> str:
        try:
            return environment.from_string(template.strip("\n")).render(view).strip()
        except (jinja2.TemplateError, TypeError, ValueError, KeyError, AttributeError) as error:
            raise InputError(f"{spec['title']}: template {template.strip()[:40]!r}: {error}") from None

    view |= {"text": text, "head": text(spec.get("head", ""))}
    lines = text(spec.get("page", PAGE)).split("\n")
    return "\n".join(line.rstrip() for line in lines) + "\n"


def _table(spec: Spec, name: str) -> Spec:
    for one in sorted(spec["tables"], key=lambda one: "split" in one):
        if one["name"] == name or "split" in one:
            return {**one, "name": name}
    raise KeyError(f"no table {name!r}")


def _value(cells: pd.DataFrame, metric: str, row: str, column: str, what: str = "mean") -> float:
    """One number of one cell; nan where there is none."""
    at = (cells.metric == metric) & (cells["row"] == row) & (cells.column == column)
    return float(cells[at][what].iloc[0]) if at.any() else math.nan


def table_of(cells: pd.DataFrame, table: Spec) -> str:
    """The Markdown of one table."""
    return markdown(lines_of(cells, table))


def lines_of(cells: pd.DataFrame, table: Spec) -> list[list[str]]:
    """One table, its header first: its rows over its columns, in the order in which they come or that it names.

    A study's table may say: head (above the rows' names), digits (significant ones), format (of all cells, or by
    column, row, "row: column" or "default": "{mean:.1f}{interval:.1f}"), columns (their titles and order),
    missing (what stands where there is no cell), n (`each`: in every cell; `shared`: in a line of its own where all our
    rows share it).
    """
    mine = cells[cells.metric == table["name"]]
    titles = {str(key): str(title) for key, title in table.get("columns", {}).items()}
    columns = [column for column in titles if column in set(mine.column)]
    columns += [column for column in dict.fromkeys(mine.column) if column not in titles]
    places = {(one["row"], one["column"]): one for one in mine.to_dict("records")}
    shared = _shared(mine, columns) if table.get("n") == "shared" else None
    with_n = table.get("n") in ("each", "shared") and shared is None
    lines = [[table.get("head", ""), *(titles.get(column, column) for column in columns)]]
    lines += [["n", *shared]] if shared is not None else []
    for row in dict.fromkeys(mine["row"]):
        lines.append([row, *(_cell(places.get((row, column)), table, with_n) for column in columns)])
    return lines


def markdown(lines: Sequence[Sequence[str]]) -> str:
    """A Markdown table, the header first: the first column to the left, the others to the right."""
    rule = ["---", *["---:"] * (len(lines[0]) - 1)]
    return "\n".join("| " + " | ".join(line) + " |" for line in [lines[0], rule, *lines[1:]])


def _shared(mine: pd.DataFrame, columns: Sequence[str]) -> list[str] | None:
    """How many instances each column has, where all rows but the paper's agree on it."""
    counts = mine[~mine["row"].str.startswith("paper")].groupby("column").n.agg(["nunique", "max"]).reindex(columns)
    return [f"{most:g}" for most in counts["max"]] if (counts["nunique"] == 1).all() else None


class _Interval(NamedTuple):
    """Of a cell, in a format: "{interval:.1f}" is " [1.0, 2.5]", or nothing where there is none."""

    low: float
    high: float

    def __format__(self, spec: str) -> str:
        return "" if math.isnan(self.low) else f" [{self.low:{spec}}, {self.high:{spec}}]"


class _Spread(NamedTuple):
    """Of a cell over several runs, in a format: "{spread:.1f}" is " (0.4) [1.0, 2.5]", or nothing where it is one."""

    sd: float
    low: float
    high: float

    def __format__(self, spec: str) -> str:
        return "" if math.isnan(self.sd) else f" ({self.sd:{spec}}){_Interval(self.low, self.high):{spec}}"


def _cell(one: Mapping[str, Any] | None, table: Spec, with_n: bool) -> str:
    if one is None:
        return str(table.get("missing", "-"))
    if one.get(TEXT):
        return str(one[TEXT])
    formats = table.get("format", {})
    keys = (f"{one['row']}: {one['column']}", one["column"], one["row"], "default")
    template = formats if isinstance(formats, str) else next((formats[key] for key in keys if key in formats), None)
    if math.isnan(one["mean"]):
        return "-"
    if template:
        interval = _Interval(one["low"], one["high"])
        spread = _Spread(one["sd"], *interval)
        return str(template.format(**one, half=one["high"] - one["mean"], interval=interval, spread=spread))
    digits = table.get("digits", 3)
    text = significant(one["mean"], digits)
    if not math.isnan(one["sd"]):
        text += f" ({significant(one['sd'], 2)})"
    if not math.isnan(one["low"]):
        text += f" [{significant(one['low'], digits)}, {significant(one['high'], digits)}]"
    return f"{text}, n {one['n']:.0f}" if with_n and not math.isnan(one["n"]) else text


def significant(value: float, digits: int) -> str:
    """A number to significant digits, never with an exponent; whole numbers as such."""
    if math.isnan(value):
        return "-"
    whole = value == round(value) or abs(value) >= 10 ** (digits - 1)
    return f"{value:,.0f}" if whole else f"{value:#.{digits}g}".rstrip(".")
