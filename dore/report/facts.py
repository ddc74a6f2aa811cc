"""What a page's prose says of its runs: commits, versions, seeds, counts, and what each run changes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd

from dore.errors import InputError
from dore.report.expressions import chosen, names_in
from dore.report.frame import Source, Spec


def facts_of(spec: Spec, sources: Mapping[str, Source]) -> dict[str, Any]:
    """What the page's prose needs to know of the runs: commits, seeds, and what else the study's `facts` name."""
    runs = [source.runs for source in sources.values() if not source.runs.empty]
    every = pd.concat(runs, ignore_index=True) if runs else pd.DataFrame()
    found = {"commit": _unique(every, "about.commit"), "torch": _unique(every, "about.versions.torch")}
    return found | {name: _fact(name, fact, sources[fact["from"]]) for name, fact in spec.get("facts", {}).items()}


def _fact(name: str, fact: Spec, source: Source) -> Any:
    """Of the runs: a key's values, one line each, or what each changes; of the rows: how many, or how many of each."""
    if "run" in fact:
        return _unique(chosen(f"facts.{name}", source.runs, fact), fact["run"])
    if "lines" in fact:
        return _lines(f"facts.{name}", source.runs, fact)
    if "changes" in fact:
        return _changes(source.runs, fact)
    rows = chosen(f"facts.{name}", source.rows, fact)
    if "by" in fact:
        return "-".join(map(str, sorted(set(rows.groupby(fact["by"]).size()))))
    return len(rows)


def _lines(name: str, runs: pd.DataFrame, fact: Spec) -> list[str] | dict[str, str]:
    """One line per run, each once, or by a name of the run; `0[config.seed]` is the run's value of that key."""
    if runs.empty:
        return []
    some = chosen(name, runs, fact)
    try:
        lines = {
            str(one.get(fact.get("by"), number)): fact["lines"].format(one)
            for number, one in enumerate(some.to_dict("records"))
        }
    except (KeyError, ValueError) as error:
        raise InputError(f"{name}: {fact['lines']!r}: {error}") from None
    return lines if "by" in fact else list(dict.fromkeys(lines.values()))


def _changes(runs: pd.DataFrame, fact: Spec) -> list[str]:
    """For each run what its config sets differently than the run that is like it but for `from_run`.

    Raises:
        InputError: there is no such run.
    """
    if runs.empty:
        return []
    names, plain = names_in(fact["changes"]), fact["from_run"]
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
