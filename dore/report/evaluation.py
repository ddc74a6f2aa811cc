"""Run planners on a set of instances: one row per instance and planner; nothing is averaged here."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from dore.errors import InputError, whole
from dore.files import ROWS_FILE
from dore.planners.base import Planner
from dore.report.progress import ProgressBar
from dore.report.rows import Row, Timing, append_row, read_rows, write_rows
from dore.world.instances import InstanceSet
from dore.world.plan import Plan, PlanError, replay
from dore.world.problem import Batch, Problem, cell_id

PARTIAL = "rows.part.csv"
"""What rows.csv is called until it is complete."""


def evaluate_into(
    folder: Path, planners: Sequence[Planner], instances: InstanceSet, timing: Timing, batch_size: int = 1024
) -> None:
    """Evaluate planners into a folder's rows.csv, each row on the disk as it comes.

    What a kill loses is the instance, or the batch, that it comes in.

    Raises:
        InputError: what `rows_as_they_come` raises, or a rows.part.csv that cannot be read.
        PlanError: a plan that does not replay.
    """
    collect_rows(folder, Row, lambda done: rows_as_they_come(planners, instances, timing, done, batch_size))


def collect_rows(folder: Path, kind: type[Row], rows: Callable[[pd.DataFrame], Iterator[Row]]) -> None:
    """Make a folder's rows.csv; where a killed evaluation has left a rows.part.csv, it is resumed.

    kind: of the rows. rows: those that are missing, given those that are done.

    Raises:
        InputError: a rows.part.csv that cannot be read, and what `rows` raises.
    """
    partial = folder / PARTIAL
    if partial.exists():
        _cut_unfinished_line(partial)
    else:
        write_rows(partial, [], kind)
    done = read_rows(partial)
    with partial.open("a", encoding="utf-8", newline="") as file:
        for row in rows(done):
            append_row(file, row)
    partial.replace(folder / ROWS_FILE)


def _cut_unfinished_line(path: Path) -> None:
    """Drop what follows the last line's end."""
    whole_lines = path.read_bytes().rpartition(b"\n")
    with path.open("rb+") as file:
        file.truncate(len(whole_lines[0]) + len(whole_lines[1]))


def rows_as_they_come(
    planners: Sequence[Planner], instances: InstanceSet, timing: Timing, done: pd.DataFrame, batch_size: int
) -> Iterator[Row]:
    """Plan every instance with every planner, and replay every plan once more, whichever planner made it.

    Each planner first plans the first instance untimed, so that no row pays for what happens only once
    (compiling, first allocations).

    Args:
        timing: plan the instances one at a time, or `batch_size` together.
        done: rows that exist already, and are not made again. A batch of which one row is missing is planned
            whole, as it would have been.

    Raises:
        InputError: two planners of one name, a batch size below 1, or a done row that is from another evaluation.
        PlanError: a plan that does not replay; names the planner, the instance, the move and why.
    """
    names = [planner.name for planner in planners]
    if len(set(names)) < len(names):
        raise InputError(f"planners: got {', '.join(names)}, want different names")
    step = 1 if timing is Timing.SINGLE else whole("batch_size", batch_size, 1)
    problems = list(instances)
    check_done(done, names, problems, timing)
    with ProgressBar(total=len(planners) * len(problems), initial=len(done), unit="plan") as bar:
        for planner in planners:
            there = set(done.instance[done.planner == planner.name])
            if len(there) == len(problems):
                continue
            bar.set_description(planner.name)
            planner.plan(instances.batch(slice(0, 1)))
            for number, problem, plan in _plans(planner, instances, problems, step, there):
                yield row_of(planner.name, number, problem, plan, timing)
                bar.update()


def check_done(done: pd.DataFrame, names: list[str], problems: list[Problem], timing: Timing) -> None:
    """Refuse rows that these planners, instances and timing cannot have made."""
    known = done.planner.isin(names) & (done.timing == timing)
    scenes = [_scene(problem) for problem in problems] if len(done) else []
    for column in ("n_obstacles", "obstacles", "target"):
        wanted = dict(enumerate((scene[column] for scene in scenes), 1))
        known &= done[column] == done.instance.map(wanted)
    if not known.all():
        one = done[~known].iloc[0]
        raise InputError(f"rows: that of {one.planner} on instance {one.instance} is from another evaluation")


def _plans(
    planner: Planner, instances: InstanceSet, problems: list[Problem], step: int, there: Container[int]
) -> Iterator[tuple[int, Problem, Plan]]:
    """The number, problem and plan of each instance but those that have a row already."""
    for first in range(0, len(problems), step):
        part = list(enumerate(problems[first : first + step], first + 1))
        if all(number in there for number, _ in part):
            continue
        batch: Batch = instances.batch(slice(first, first + step))
        for (number, problem), plan in zip(part, planner.plan(batch), strict=True):
            if number not in there:
                yield number, problem, plan


def row_of(planner: str, number: int, problem: Problem, plan: Plan, timing: Timing) -> Row:
    """The row of one plan, if it replays.

    Raises:
        PlanError: it does not.
    """
    try:
        replay(problem, plan)
    except PlanError as error:
        raise PlanError(f"{planner}, instance {number}: {error}") from None
    return Row(
        planner=planner,
        instance=number,
        status=plan.status,
        reason=plan.reason,
        moves=len(plan.moves),
        planning_s=plan.planning_s,
        expansions=plan.expansions,
        timing=timing,
        **_scene(problem),
    )


def _scene(problem: Problem) -> dict[str, Any]:
    """What a row says of its instance: `scene=FOLDER instance=N` finds it again by that."""
    scene = problem.scene
    return {
        "n_cells": scene.layout.n_cells,
        "n_obstacles": len(scene.obstacles),
        "layout": str(scene.layout),
        "obstacles": " ".join(str(cell_id(cell)) for cell in scene.obstacles),
        "target": str(cell_id(scene.target)),
    }
