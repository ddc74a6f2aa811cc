"""Run planners on a set of instances: one row an instance and planner, and nothing is averaged here."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from enum import StrEnum
from pathlib import Path

from tqdm import tqdm

from dore.errors import InputError, atomic_write, whole
from dore.instances import InstanceSet
from dore.plan import Plan, PlanError, Scene, Status, replay
from dore.planners.base import Planner
from dore.reach import Reach
from dore.sampling import Batch


class Timing(StrEnum):
    """What `planning_s` of a row means."""

    SINGLE = "single"
    """The instance was planned alone: a latency."""
    BATCHED = "batched"
    """A batch was planned together, and this is the instance's even share: one over the throughput."""


@dataclass(frozen=True)
class Row:
    """How one planner did on one instance; the columns of rows.csv.

    instance: its number in the set, from 1. reason: why there is no solution, or empty.
    moves: rearrangements, as far as the plan goes. planning_s: wall seconds, see `timing`.
    """

    planner: str
    instance: int
    n_cells: int
    n_obstacles: int
    status: Status
    reason: str
    moves: int
    planning_s: float
    expansions: int
    timing: Timing


def evaluate(
    planners: Sequence[Planner],
    instances: InstanceSet,
    timing: Timing = Timing.SINGLE,
    batch_size: int = 1024,
    progress: bool = True,
) -> list[Row]:
    """Plan every instance with every planner, and replay every plan once more, whoever made it.

    Each planner first plans the first instance untimed, so that no row pays for what happens only once
    (compiling, first allocations).

    Args:
        timing: plan the instances one at a time, or `batch_size` together.
        progress: show a progress bar.

    Raises:
        InputError: two planners of one name, or a batch size below 1.
        PlanError: a plan that does not replay; names the planner, the instance, the move and why.
    """
    names = [planner.name for planner in planners]
    if len(set(names)) < len(names):
        raise InputError(f"planners: got {', '.join(names)}, want different names")
    step = 1 if timing is Timing.SINGLE else whole("batch_size", batch_size, 1)
    scenes = list(instances)
    rows: list[Row] = []
    with tqdm(total=len(planners) * len(scenes), unit="plan", disable=not progress) as bar:
        for planner in planners:
            bar.set_description(planner.name)
            planner.plan(instances.batch(slice(0, 1)))
            for number, scene, plan in _plans(planner, instances, scenes, step):
                rows.append(_row(planner.name, number, scene, instances.reach, plan, timing))
                bar.update()
    return rows


def _plans(
    planner: Planner, instances: InstanceSet, scenes: list[Scene], step: int
) -> Iterator[tuple[int, Scene, Plan]]:
    """Each instance's number, scene and plan."""
    for first in range(0, len(scenes), step):
        part = scenes[first : first + step]
        batch: Batch = instances.batch(slice(first, first + step))
        for offset, (scene, plan) in enumerate(zip(part, planner.plan(batch), strict=True)):
            yield first + offset + 1, scene, plan


def _row(planner: str, number: int, scene: Scene, reach: Reach, plan: Plan, timing: Timing) -> Row:
    """The row of one plan, if it replays."""
    try:
        replay(scene, reach, plan)
    except PlanError as error:
        raise PlanError(f"{planner}, instance {number}: {error}") from None
    return Row(
        planner=planner,
        instance=number,
        n_cells=reach.n_cells,
        n_obstacles=len(scene.obstacles),
        status=plan.status,
        reason=plan.reason,
        moves=len(plan.moves),
        planning_s=plan.planning_s,
        expansions=plan.expansions,
        timing=timing,
    )


COLUMNS = tuple(field.name for field in fields(Row))


def write_rows(path: str | os.PathLike[str], rows: Sequence[Row]) -> None:
    """Write rows.csv, whole or not at all."""
    with atomic_write(path) as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow(asdict(row) | {"planning_s": f"{row.planning_s:.9f}"})


def read_rows(path: str | os.PathLike[str]) -> list[Row]:
    """The inverse of `write_rows`.

    Raises:
        InputError: no such file, other columns, or a value that is wrong; names the line.
    """
    try:
        with Path(path).open(encoding="utf-8", newline="") as file:
            reader = csv.DictReader(file)
            if tuple(reader.fieldnames or ()) != COLUMNS:
                raise InputError(f"{path}: columns {reader.fieldnames}, want {', '.join(COLUMNS)}")
            return [_parse(f"{path}, line {reader.line_num}", record) for record in reader]
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read as CSV ({error})") from None


def _parse(where: str, record: dict[str, str]) -> Row:
    try:
        return Row(
            planner=record["planner"],
            instance=int(record["instance"]),
            n_cells=int(record["n_cells"]),
            n_obstacles=int(record["n_obstacles"]),
            status=Status(record["status"]),
            reason=record["reason"],
            moves=int(record["moves"]),
            planning_s=float(record["planning_s"]),
            expansions=int(record["expansions"]),
            timing=Timing(record["timing"]),
        )
    except (TypeError, ValueError) as error:
        raise InputError(f"{where}: {error}") from None
