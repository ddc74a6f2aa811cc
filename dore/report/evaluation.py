"""Run planners on a set of instances: one row an instance and planner, and nothing is averaged here."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from enum import StrEnum
from pathlib import Path

from tqdm import tqdm

from dore.errors import InputError, whole
from dore.files import ROWS_FILE, atomic_write
from dore.planners.base import Planner
from dore.world.instances import InstanceSet
from dore.world.plan import Plan, PlanError, Status, replay
from dore.world.problem import Batch, Problem


class Timing(StrEnum):
    """What `planning_s` of a row means."""

    SINGLE = "single"
    """The instance was planned alone: a latency."""
    BATCHED = "batched"
    """A batch was planned together: the share that the planner attributes to the instance. Their mean is one over the
    throughput."""


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
    """Every row that `rows_as_they_come` makes."""
    return list(rows_as_they_come(planners, instances, timing, batch_size, progress))


def rows_as_they_come(
    planners: Sequence[Planner],
    instances: InstanceSet,
    timing: Timing = Timing.SINGLE,
    batch_size: int = 1024,
    progress: bool = True,
    done: Sequence[Row] = (),
) -> Iterator[Row]:
    """Plan every instance with every planner, and replay every plan once more, whichever planner made it.

    Each planner first plans the first instance untimed, so that no row pays for what happens only once
    (compiling, first allocations).

    Args:
        timing: plan the instances one at a time, or `batch_size` together.
        progress: show a progress bar.
        done: rows that are there already, and are not made again. A batch of which one row is missing is planned
            whole, as it would have been.

    Raises:
        InputError: two planners of one name, a batch size below 1, or a done row that is of another evaluation.
        PlanError: a plan that does not replay; names the planner, the instance, the move and why.
    """
    names = [planner.name for planner in planners]
    if len(set(names)) < len(names):
        raise InputError(f"planners: got {', '.join(names)}, want different names")
    step = 1 if timing is Timing.SINGLE else whole("batch_size", batch_size, 1)
    problems = list(instances)
    _check_done(done, names, problems, timing)
    with tqdm(total=len(planners) * len(problems), initial=len(done), unit="plan", disable=not progress) as bar:
        for planner in planners:
            there = {row.instance for row in done if row.planner == planner.name}
            if len(there) == len(problems):
                continue
            bar.set_description(planner.name)
            planner.plan(instances.batch(slice(0, 1)))
            for number, problem, plan in _plans(planner, instances, problems, step, there):
                yield _row(planner.name, number, problem, plan, timing)
                bar.update()


def _check_done(done: Sequence[Row], names: list[str], problems: list[Problem], timing: Timing) -> None:
    """Refuse rows that these planners, instances and timing cannot have made."""
    for row in done:
        known = row.planner in names and row.timing is timing and 1 <= row.instance <= len(problems)
        if not known or row.n_obstacles != len(problems[row.instance - 1].scene.obstacles):
            raise InputError(f"rows: that of {row.planner} on instance {row.instance} is of another evaluation")


def _plans(
    planner: Planner, instances: InstanceSet, problems: list[Problem], step: int, there: Container[int]
) -> Iterator[tuple[int, Problem, Plan]]:
    """The number, problem and plan of each instance but those that are there already."""
    for first in range(0, len(problems), step):
        part = list(enumerate(problems[first : first + step], first + 1))
        if all(number in there for number, _ in part):
            continue
        batch: Batch = instances.batch(slice(first, first + step))
        for (number, problem), plan in zip(part, planner.plan(batch), strict=True):
            if number not in there:
                yield number, problem, plan


def _row(planner: str, number: int, problem: Problem, plan: Plan, timing: Timing) -> Row:
    """The row of one plan, if it replays."""
    try:
        replay(problem, plan)
    except PlanError as error:
        raise PlanError(f"{planner}, instance {number}: {error}") from None
    return Row(
        planner=planner,
        instance=number,
        n_cells=problem.reach.n_cells,
        n_obstacles=len(problem.scene.obstacles),
        status=plan.status,
        reason=plan.reason,
        moves=len(plan.moves),
        planning_s=plan.planning_s,
        expansions=plan.expansions,
        timing=timing,
    )


ROW_COLUMNS = tuple(field.name for field in fields(Row))
PARTIAL = "rows.part.csv"


def evaluate_into(folder: Path, planners: Sequence[Planner], instances: InstanceSet, timing: Timing) -> None:
    """`evaluate` into a folder's rows.csv, each row on the disk as it comes.

    Until all rows are there the file is called rows.part.csv. Where a killed evaluation has left one, it goes on
    from there, so that what is lost is the instance, or the batch, that it was killed in.

    Raises:
        InputError: what `rows_as_they_come` raises, or a rows.part.csv that cannot be read.
    """
    partial = folder / PARTIAL
    done = _whole_rows(partial)
    write_rows(partial, done)
    with partial.open("a", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, ROW_COLUMNS, lineterminator="\n")
        for row in rows_as_they_come(planners, instances, timing, done=done):
            writer.writerow(_record(row))
            file.flush()
    partial.replace(folder / ROWS_FILE)


def write_rows(path: str | os.PathLike[str], rows: Sequence[Row]) -> None:
    """Write rows.csv, whole or not at all."""
    with atomic_write(path) as file:
        writer = csv.DictWriter(file, ROW_COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(map(_record, rows))


def _record(row: Row) -> dict[str, object]:
    return asdict(row) | {"planning_s": f"{row.planning_s:.9f}"}


def read_rows(path: str | os.PathLike[str]) -> list[Row]:
    """The inverse of `write_rows`.

    Raises:
        InputError: no such file, other columns, or a value that is wrong; names the line.
    """
    try:
        with Path(path).open(encoding="utf-8", newline="") as file:
            return _rows_in(file, path)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read as CSV ({error})") from None


def _whole_rows(path: Path) -> list[Row]:
    """The rows of a file that was being written: a last line that was cut off is left out; none without a file."""
    if not path.exists():
        return []
    text = path.read_bytes()
    try:
        return _rows_in(io.StringIO(text[: text.rfind(b"\n") + 1].decode()), path)
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read as CSV ({error})") from None


def _rows_in(file: Iterable[str], path: str | os.PathLike[str]) -> list[Row]:
    """The rows of an open file; messages call it `path`."""
    reader = csv.DictReader(file)
    if tuple(reader.fieldnames or ()) != ROW_COLUMNS:
        raise InputError(f"{path}: columns {reader.fieldnames}, want {', '.join(ROW_COLUMNS)}")
    return [_parse(f"{path}, line {reader.line_num}", record) for record in reader]


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
