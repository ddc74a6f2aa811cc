"""What a study says in pandas' own words: conditions and expressions over the columns of its rows."""

from __future__ import annotations

import string
from collections.abc import Mapping
from typing import Any

import pandas as pd

from dore.errors import InputError


def evaluated(name: str, rows: pd.DataFrame, expression: str) -> pd.Series:
    """One value per row.

    Raises:
        InputError: an expression that does not fit the rows; `name` says whose.
    """
    try:
        found: pd.Series = rows.eval(expression, engine="python")
    except Exception as error:  # pandas passes on whatever an expression raises.
        raise InputError(f"{name}: {expression!r}: {' '.join(str(error).split())}") from None
    return found


def chosen(name: str, rows: pd.DataFrame, node: Mapping[str, Any], key: str = "where") -> pd.DataFrame:
    """The rows that fulfil the condition `key` of a part of a study; all of them where it has none."""
    if key not in node or rows.empty:
        return rows
    return rows[evaluated(f"{name}.{key}", rows, node[key]).astype(bool)]


def numbers(rows: pd.DataFrame, of: str) -> pd.Series:
    """One number per row: a column, or an expression over columns, as `100 * success`.

    Raises:
        InputError: no such column, or not an expression.
    """
    found = rows[of] if of in rows else evaluated("of", rows, of)
    return pd.Series(found, rows.index).astype(float)


def names_in(template: str) -> list[str]:
    """The names in braces: `{size}, {planner}` has two."""
    return [name for _, name, _, _ in string.Formatter().parse(template) if name]
