"""What runs left behind as data frames: evaluations, trainings, tables; and the cells of a page as CSV."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from dore.configure import leaves
from dore.errors import InputError
from dore.files import ABOUT_FILE, CONFIG_FILE, DONE_FILE, METRICS_FILE, ROWS_FILE, atomic_write, read_done, read_json
from dore.report.evaluation import ROW_COLUMNS

EXECUTION, ARGUMENTS = "execution.json", "arguments.json"
PUSHED_MM = 5.0
"""An object that should not move was pushed if it moved by more than this."""
CELL = ("metric", "row", "column", "n", "mean", "sd", "low", "high")
TEXT = "text"
"""A column that a table of cells may have besides: shown instead of the numbers."""


@dataclass(frozen=True)
class Source:
    """One kind of data of a study.

    rows: a row an instance and planner, a test of a training, or a line of a CSV file, with the names that the
    folder's pattern gives. runs: a row a folder, with everything in its config, about and done files, dotted.
    world: the columns that, with `instance`, say which problem a row is of.
    committed: read from the tables beside the page, not from runs.
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


def evaluations(root: Path, pattern: str, same: Sequence[str] = (), keep: dict[str, str] | None = None) -> Source:
    """Every rows.csv of the folders of a pattern.

    Args:
        same: names in the pattern that make a world; evaluations of one world must have had the same instances.
        keep: columns to add, and the dotted key of the run that each is taken from.

    Raises:
        InputError: a damaged file, or two evaluations of one world that differ in their instances.
    """
    rows, runs = [], []
    for folder, names in folders(root, pattern, ROWS_FILE):
        about = about_of(folder) | names
        runs.append(about)
        table = read_table(folder / ROWS_FILE, ROW_COLUMNS, text=("planner", "status", "reason", "timing"))
        rows.append(
            table.assign(folder=str(folder), **names, **{name: about.get(key) for name, key in (keep or {}).items()})
        )
    if not rows:
        return Source(pd.DataFrame(columns=[*ROW_COLUMNS]))
    every = pd.DataFrame(runs)
    _check_same(every, list(same))
    return Source(_with_proofs(pd.concat(rows, ignore_index=True), list(same)), every)


INSTANCES = (
    *("layout", "reach", "split", "limit", "instances.seed", "instances.test_size"),
    *("instances.validation_size", "instances.min_obstacles", "instances.max_obstacles"),
)
"""What of a config decides which instances are planned."""


def _check_same(runs: pd.DataFrame, same: list[str]) -> None:
    keys = [key for key in runs if any(key == f"config.{one}" or key.startswith(f"config.{one}.") for one in INSTANCES)]
    for world, group in runs.groupby(same or (lambda _: 0)):
        for key in keys:
            values = group[key].map(str).unique()
            # An evaluation on the test split does not depend on how many boards validate.
            if len(values) > 1 and not key.endswith("validation_size"):
                raise InputError(f"{world}: {key} is {' and '.join(values)}, want the same instances")


def _with_proofs(rows: pd.DataFrame, same: list[str]) -> pd.DataFrame:
    """Each row with what is known of its instance: whether anyone solved it, or proved it unsolvable, the optimum."""
    at = [*same, "instance"]
    rows["solved"] = rows.status == "solved"
    rows["solvable"] = rows.solved.groupby([rows[key] for key in at]).transform("any")
    unsolvable = rows.status == "unsolvable"
    rows["unsolvable"] = unsolvable.groupby([rows[key] for key in at]).transform("any")
    rows["undecided"] = ~(rows.solvable | rows.unsolvable)
    proved = rows.moves.where((rows.planner == "exact") & rows.solved).groupby([rows[key] for key in at])
    least, most = proved.transform("min"), proved.transform("max")
    if (least < most).any() or (rows.solvable & rows.unsolvable).any():
        bad = rows[(least < most) | (rows.solvable & rows.unsolvable)].iloc[0]
        raise InputError(
            f"instance {bad.instance} of {bad[same].to_dict()}: two proofs disagree, want the same instances"
        )
    rows["optimum"] = least
    return rows


def trainings(root: Path, pattern: str) -> Source:
    """Every training of the folders of a pattern that has ended, one row a test (IPT).

    Raises:
        InputError: a damaged file.
    """
    rows, runs = [], []
    for folder, names in folders(root, pattern, DONE_FILE):
        about = about_of(folder) | names
        runs.append(about)
        tests = read_table(folder / METRICS_FILE, ("episodes", "seconds", "success", "updates"), text=())
        tests = tests[tests.success.notna()]
        rows.append(tests.assign(**about, best=tests.success.max()) if len(tests) else pd.DataFrame([about]))
    return Source(pd.concat(rows, ignore_index=True) if rows else pd.DataFrame(), pd.DataFrame(runs))


def executions(root: Path, pattern: str) -> Source:
    """Every execution of the folders of a pattern that ended, from its report; what was measured per move is reduced.

    pushed: moves in which an object that should stand still moved by more than `PUSHED_MM`. faults, plans: how many a
    closed loop noted. The folder of each kind of executions says in arguments.json what they are.
    """
    rows: list[dict[str, Any]] = []
    kinds: dict[Path, dict[str, Any]] = {}
    for folder, names in folders(root, pattern, EXECUTION):
        report = read_json(folder / EXECUTION)
        of_kind = root / pattern.partition("/")[0].format(**names)
        kind = kinds.setdefault(of_kind, names | {"unfinished": 0} | about_of(of_kind))
        if report["finished"]:
            rows.append(names | _execution(report))
        else:
            kind["unfinished"] += 1
    frame = pd.DataFrame(rows)
    for name in ("obstacles", "column"):
        if name in frame:
            frame[name] = frame[name].astype(int)
    return Source(frame, pd.DataFrame(list(kinds.values())))


def _execution(report: dict[str, Any]) -> dict[str, Any]:
    """One row of `executions`."""
    moves, events = pd.DataFrame(report["moves"]), [event["event"] for event in report["events"]]
    disturbances = [event["text"] for event in report["events"] if event["event"] == "disturbance"]
    worst = {name: moves[name].max() for name in ("others_moved_mm", "placement_error_mm", "tilt_deg") if name in moves}
    return {
        "disturbance": disturbances[0] if disturbances else "",
        **{key: report[key] for key in ("outcome", "refused", "success", "claimed")},
        "toppled": report["outcome"] == "toppled" or report["conditions"].get("all_upright") is False,
        "moves": len(moves),
        "pushed": int((moves["others_moved_mm"] > PUSHED_MM).sum()) if len(moves) else 0,
        "faults": events.count("fault"),
        "plans": events.count("plan"),
        **worst,
        "grasp_margin_mm": moves["grasp_margin_mm"].min() if len(moves) else 0.0,
        **{key: report[key] for key in ("simulated_s", "rehearsal_s", "wall_s", "message")},
    }


def tables(folder: Path, pattern: str) -> Source:
    """CSV files, one below the other; a NAME.json beside NAME.csv gives columns that are the same in all its lines."""
    rows, runs = [], []
    for path in sorted(folder.glob(pattern)):
        about = read_json(path.with_suffix(".json")) if path.with_suffix(".json").exists() else {}
        about = {
            name: "" if value is None else value for name, value in about.items() if not isinstance(value, list | dict)
        }
        about["file"] = path.stem
        runs.append(about)
        table = read_table(path, (), text=None)
        rows.append(table.assign(**about) if len(table) else pd.DataFrame([about]))
    return Source(pd.concat(rows, ignore_index=True) if rows else pd.DataFrame(), pd.DataFrame(runs))


def about_of(folder: Path) -> dict[str, Any]:
    """Everything that a run's own files say of it, under dotted names: config, about, done, arguments."""
    config = folder / CONFIG_FILE
    files = {
        "config": yaml.safe_load(config.read_text(encoding="utf-8")) if config.exists() else {},
        "about": read_json(folder / ABOUT_FILE) if (folder / ABOUT_FILE).exists() else {},
        "done": read_done(folder) or {},
        "arguments": read_json(folder / ARGUMENTS) if (folder / ARGUMENTS).exists() else {},
    }
    # A list is one value, written out.
    return {key: str(value) if isinstance(value, list) else value for key, value in leaves(files)}


def read_table(path: Path, columns: Sequence[str], text: Sequence[str] | None) -> pd.DataFrame:
    """A CSV file, its `text` columns as text; where `text` is None the columns are what their values look like.

    Raises:
        InputError: no such file, a missing column, or a value that is not a number.
    """
    try:
        found = pd.read_csv(path, dtype=dict.fromkeys(text or (), str), keep_default_na=False, na_values=[""])
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (ValueError, OSError) as error:
        raise InputError(f"{path}: cannot be read as CSV ({' '.join(str(error).split())})") from None
    if missing := sorted(set(columns) - set(found.columns)):
        raise InputError(f"{path}: no column {', '.join(missing)}")
    for name in text or ():
        found[name] = found[name].fillna("") if name in found else ""
    if text is not None:
        for name in (one for one in columns if one not in text):
            wrong = pd.to_numeric(found[name], errors="coerce").isna() & found[name].notna()
            if wrong.any():
                raise InputError(
                    f"{path}, line {wrong.idxmax() + 2}: {name} {found[name][wrong.idxmax()]!r}, want a number"
                )
    return found


def write_cells(path: Path, cells: pd.DataFrame) -> None:
    """The cells of a page as CSV, to 9 significant digits: more than a page shows, so that both say the same."""
    columns = [*CELL, *([TEXT] if TEXT in cells and cells[TEXT].astype(bool).any() else [])]
    cells = cells[columns].copy()
    cells["n"] = cells["n"].astype("Int64")
    with atomic_write(path) as file:
        cells.to_csv(file, index=False, float_format="%.9g", lineterminator="\n")


def read_cells(path: Path) -> pd.DataFrame:
    """The inverse of `write_cells`, but for the digits.

    Raises:
        InputError: no such file, or not a table of cells.
    """
    cells = read_table(path, CELL, text=("metric", "row", "column", TEXT))
    cells[list(CELL[3:])] = cells[list(CELL[3:])].astype(float)
    return cells
