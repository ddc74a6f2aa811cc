"""What runs left behind, as data frames: evaluations, trainings, measurements, and rows kept by a page."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from dore.configure import leaves, renamed
from dore.errors import InputError
from dore.files import ABOUT_FILE, CONFIG_FILE, DONE_FILE, METRICS_FILE, ROWS_FILE, read_done, read_record
from dore.report.rows import ROW_COLUMNS, read_rows, read_table

Spec = Mapping[str, Any]
"""A study's file, or a part of it."""


@dataclass(frozen=True)
class Source:
    """One kind of data of a study.

    rows: one per instance and planner, test of a training, or line of a CSV file, with the names that the
    folder's pattern gives. runs: one row per folder, with everything in its config, about and done files, dotted.
    world: the columns that, with `instance`, say which problem a row is of.
    committed: kept beside the page, not read from runs.
    """

    rows: pd.DataFrame
    runs: pd.DataFrame = field(default_factory=pd.DataFrame)
    world: tuple[str, ...] = ()
    committed: bool = False


def folders(root: Path, pattern: str, wanted: str) -> Iterator[tuple[Path, dict[str, str]]]:
    """The folders like `{run}_{column}` below `root` that hold a file `wanted`, and the names in each."""
    named = re.sub(r"\\{(\w+)\\}", r"(?P<\1>[^/]+?)", re.escape(pattern))
    anything = re.sub(r"{\w+}", "*", pattern)
    for path in sorted(root.glob(f"{anything}/{wanted}")):
        found = re.fullmatch(named, path.parent.relative_to(root).as_posix())
        if found:
            yield path.parent, found.groupdict()


def evaluations(root: Path, pattern: str, same: Sequence[str] = (), keep: Mapping[str, str] | None = None) -> Source:
    """Every rows.csv of the folders of a pattern.

    Args:
        same: names in the pattern that make a world; evaluations of one world must have had the same instances.
        keep: columns to add, and the dotted key of the run that each is taken from.

    Raises:
        InputError: a damaged file, or two evaluations of one world that differ in their instances.
    """
    found = _source(root, pattern, ROWS_FILE, keep, lambda folder, _: _evaluation(folder))
    if found.runs.empty:
        return Source(pd.DataFrame(columns=[*ROW_COLUMNS]))
    _check_same_instances(found.runs, list(same))
    return Source(_with_proofs(found.rows, list(same)), found.runs)


def _evaluation(folder: Path) -> pd.DataFrame:
    rows = read_rows(folder / ROWS_FILE)
    if rows.groupby("planner").instance.agg(frozenset).nunique() != 1:
        planners = ", ".join(rows.planner.unique()) or "no planner"
        raise InputError(f"{folder / ROWS_FILE}: rows of {planners}, want the same instances of each")
    return rows.assign(folder=str(folder))


def measurements(root: Path, pattern: str, keep: Mapping[str, str] | None = None) -> Source:
    """Every rows.csv of a measuring program in the folders of a pattern, with the names that the pattern gives.

    Args:
        keep: as of `evaluations`.

    Raises:
        InputError: a damaged file.
    """
    return _source(root, pattern, ROWS_FILE, keep, lambda folder, _: read_table(folder / ROWS_FILE, (), text=None))


def trainings(root: Path, pattern: str) -> Source:
    """Every training of the folders of a pattern that has ended, one row per test (IPT).

    Raises:
        InputError: a damaged file.
    """
    return _source(root, pattern, DONE_FILE, None, _tests)


def _tests(folder: Path, about: Mapping[str, Any]) -> pd.DataFrame:
    tests = read_table(folder / METRICS_FILE, ("episodes", "seconds", "success", "updates"), text=())
    tests = tests[tests.success.notna()]
    if tests.empty:
        return pd.DataFrame([about])
    more = pd.DataFrame({**about, "best": tests.success.max()}, index=tests.index)
    return pd.concat([tests.drop(columns=tests.columns.intersection(more.columns)), more], axis=1)


Read = Callable[[Path, Mapping[str, Any]], pd.DataFrame]


def _source(root: Path, pattern: str, wanted: str, keep: Mapping[str, str] | None, read: Read) -> Source:
    """What `read` makes of each folder of a pattern and of what is known of its run."""
    rows, runs = [], []
    for folder, names in folders(root, pattern, wanted):
        about = about_of(folder) | names
        runs.append(about)
        rows.append(read(folder, about).assign(**names, **{name: about.get(key) for name, key in (keep or {}).items()}))
    return Source(_stacked(rows), pd.DataFrame(runs))


def _stacked(frames: Sequence[pd.DataFrame]) -> pd.DataFrame:
    return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame()


INSTANCES = (
    *("layout", "reach", "split", "limit", "instances.path", "instances.seed", "instances.test_size"),
    *("instances.validation_size", "instances.min_obstacles", "instances.max_obstacles"),
)
"""What of a config decides which instances are planned."""


def _check_same_instances(runs: pd.DataFrame, same: list[str]) -> None:
    keys = [key for key in runs if any(key == f"config.{one}" or key.startswith(f"config.{one}.") for one in INSTANCES)]
    for world, group in runs.groupby(same or (lambda _: 0)):
        for key in keys:
            values = group[key].map(str).unique()
            # An evaluation on the test split does not depend on how many boards validate.
            if len(values) > 1 and not key.endswith("validation_size"):
                raise InputError(f"{world}: {key} is {' and '.join(values)}, want the same instances")


def _with_proofs(rows: pd.DataFrame, same: list[str]) -> pd.DataFrame:
    """Each row with what is known of its instance: whether anyone solved it, or proved it unsolvable, the optimum."""
    rows["solved"], rows["unsolvable"] = rows.status == "solved", rows.status == "unsolvable"
    if "stratum" in rows:  # A benchmark knows what its instances are, and its rows agree with that.
        return rows.assign(solvable=rows.optimum.notna(), unsolvable=rows.optimum.isna(), undecided=False)
    rows["optimum"] = rows.moves.where((rows.planner == "exact") & rows.solved)
    of_instance = rows.groupby([*same, "instance"])
    least, most = (of_instance.optimum.transform(one) for one in ("min", "max"))
    solvable, unsolvable = (of_instance[one].transform("any") for one in ("solved", "unsolvable"))
    wrong = (least < most) | (solvable & unsolvable)
    if wrong.any():
        bad = rows[wrong].iloc[0]
        raise InputError(
            f"instance {bad.instance} of {bad[same].to_dict()}: two proofs disagree, want the same instances"
        )
    return rows.assign(solvable=solvable, unsolvable=unsolvable, undecided=~(solvable | unsolvable), optimum=least)


def kept(folder: Path, pattern: str) -> Source:
    """CSV files, one below the other; a NAME.json beside NAME.csv gives columns that are the same in all its lines."""
    rows, runs = [], []
    for path in sorted(folder.glob(pattern)):
        about = {
            name: "" if value is None else value
            for name, value in read_record(path.with_suffix(".json")).items()
            if not isinstance(value, list | dict)
        } | {"file": path.stem}
        runs.append(about)
        table = read_table(path, (), text=None)
        rows.append(table.assign(**about) if len(table) else pd.DataFrame([about]))
    return Source(_stacked(rows), pd.DataFrame(runs), committed=True)


def about_of(folder: Path) -> dict[str, Any]:
    """Everything that a run's own files say of it, under dotted names: config (its classes by today's names), about,
    done."""
    config = folder / CONFIG_FILE
    files = {
        "config": renamed(yaml.safe_load(config.read_text(encoding="utf-8"))) if config.exists() else {},
        "about": read_record(folder / ABOUT_FILE),
        "done": read_done(folder),
    }
    # A list is one value, written out.
    return {key: str(value) if isinstance(value, list) else value for key, value in leaves(files)}
