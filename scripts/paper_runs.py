"""The runs behind a table: read from their folders, checked to be of one kind, and merged."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from omegaconf import DictConfig

from dore.app.run_folder import DONE, read_config
from dore.errors import InputError
from dore.report.evaluation import ROWS, Row, read_rows
from dore.world.plan import Status

MODELS = ("single", "sequential")
SAME = ("layout", "reach", "instances", "split", "limit", "timing", "threads")
"""What both models' evaluations of a column must share."""


@dataclass(frozen=True)
class Runs:
    """All that a table is made from.

    columns: every planner's rows by the number of obstacles. world: the config of the first column's evaluation.
    trained: each model's done.json, training: its config. commits, torch: of all runs.
    """

    columns: dict[int, list[Row]]
    world: DictConfig
    trained: dict[str, dict[str, Any]]
    training: dict[str, DictConfig]
    commits: list[str]
    torch: list[str]


def read_runs(folder: Path) -> Runs:
    """Read `folder`/single and `folder`/sequential: train/ and, for each number Z of obstacles, zZ/.

    Raises:
        InputError: a run that is missing or not done, or evaluations that differ in more than their planners.
    """
    columns = {}
    for z in _numbers(folder):
        paths = [folder / model / f"z{z}" for model in MODELS]
        _check_same_config(*paths)
        single, sequential = (read_rows(path / ROWS) for path in paths)
        wrong = {row.n_obstacles for row in (*single, *sequential)} - {z}
        if wrong:
            raise InputError(f"{paths[0]}: rows of {min(wrong)} obstacles, want {z}")
        columns[z] = merged(single, sequential)
    trained = {model: folder / model / "train" for model in MODELS}
    abouts = [
        _read_json(path / "about.json")
        for path in (*trained.values(), *(folder / model / f"z{z}" for model in MODELS for z in columns))
    ]
    return Runs(
        columns=columns,
        world=read_config(folder / MODELS[0] / f"z{min(columns)}", expected=(*SAME, "planners")),
        trained={model: _read_json(path / DONE) for model, path in trained.items()},
        training={model: read_config(path, expected=("seed", "training")) for model, path in trained.items()},
        commits=sorted({str(about["commit"]) for about in abouts}),
        torch=sorted({about["versions"]["torch"] for about in abouts}),
    )


def merged(single: Sequence[Row], sequential: Sequence[Row]) -> list[Row]:
    """The rows of both models' evaluations as one set, `exact` once and last.

    `learned` and `transfer` are named after their model, as in `learned (single)`.

    Raises:
        InputError: they did not see the same instances, as far as what `exact` proved in both can tell.
    """
    first, second = ({row.instance: row for row in rows if row.planner == "exact"} for rows in (single, sequential))
    if not first or first.keys() != second.keys():
        raise InputError(f"rows: exact has {len(first)} and {len(second)} instances, want the same in both evaluations")
    for number, one in first.items():
        other = second[number]
        same = (one.n_cells, one.n_obstacles) == (other.n_cells, other.n_obstacles)
        # Giving up hangs on the clock; what is proved does not.
        decided = Status.GAVE_UP not in (one.status, other.status)
        if not same or (decided and (one.status, one.moves) != (other.status, other.moves)):
            raise InputError(f"rows: instance {number} is {_told(one)} and {_told(other)}, want the same in both")
    named = [
        replace(row, planner=f"{row.planner} ({model})") if row.planner in ("learned", "transfer") else row
        for model, rows in zip(MODELS, (single, sequential), strict=True)
        for row in rows
        if row.planner != "exact"
    ]
    return [*named, *first.values()]


def _told(row: Row) -> str:
    return f"{row.status} with {row.moves} moves ({row.n_obstacles} obstacles)"


def _numbers(folder: Path) -> list[int]:
    """The numbers of obstacles that both models were evaluated with."""
    found = [
        sorted(int(path.name[1:]) for path in (folder / model).glob("z*") if re.fullmatch(r"z\d+", path.name))
        for model in MODELS
    ]
    if not found[0] or found[0] != found[1]:
        raise InputError(
            f"{folder}: columns {found[0]} of single and {found[1]} of sequential, want the same, and some"
        )
    return found[0]


def _check_same_config(first: Path, second: Path) -> None:
    configs = [read_config(path, expected=SAME) for path in (first, second)]
    for key in SAME:
        one, other = (cfg[key] for cfg in configs)
        if one != other:
            raise InputError(f"{second}: {key} {other}, but {one} in {first}, want the same")


def _read_json(path: Path) -> dict[str, Any]:
    try:
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; want a run that is done") from None
    except ValueError as error:
        raise InputError(f"{path}: damaged ({error})") from None
    return found
