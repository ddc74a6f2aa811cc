"""Run planners on a set of instances: one row per instance and planner; nothing is averaged here."""

from __future__ import annotations

import time
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from dore.errors import InputError, whole
from dore.files import ROWS_FILE
from dore.planners.base import Planner
from dore.report.progress import ProgressBar
from dore.report.rows import BenchmarkRow, Row, Timing, append_row, read_rows, write_rows
from dore.world.benchmark import BenchmarkSet
from dore.world.instances import InstanceSet
from dore.world.plan import Plan, PlanError, Status, replay
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


class Part(NamedTuple):
    """Planners that were all built for one layout and reach, and instances of it.

    first: the number of the first instance. about: of each instance, what its rows of a benchmark say more.
    """

    planners: Sequence[Planner]
    instances: InstanceSet
    first: int = 1
    about: Sequence[Mapping[str, Any]] = ()


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
    return rows_of_parts([Part(planners, instances)], timing, done, batch_size)


def benchmark_rows(
    sets: Sequence[BenchmarkSet], planners: Sequence[Sequence[Planner]], timing: Timing, done: pd.DataFrame
) -> Iterator[Row]:
    """As `rows_as_they_come` on a benchmark, instances numbered through; planners: those for each of its sets.

    Raises:
        InputError: what `rows_as_they_come` raises.
        PlanError: also of a plan with fewer moves than the proved optimum, or of a wrong proof.
    """
    firsts = accumulate((len(one.instances) for one in sets), initial=1)
    parts = [
        Part(ours, one.instances, first, one.about) for ours, one, first in zip(planners, sets, firsts, strict=False)
    ]
    return rows_of_parts(parts, timing, done, batch_size=1024)


def rows_of_parts(parts: Sequence[Part], timing: Timing, done: pd.DataFrame, batch_size: int) -> Iterator[Row]:
    """The rows of all parts, one after the other; see `rows_as_they_come`."""
    names = [planner.name for planner in parts[0].planners]
    if len(set(names)) < len(names):
        raise InputError(f"planners: got {', '.join(names)}, want different names")
    step = 1 if timing is Timing.SINGLE else whole("batch_size", batch_size, 1)
    numbered = {number: problem for part in parts for number, problem in enumerate(part.instances, part.first)}
    check_done(done, names, numbered, timing)
    with ProgressBar(total=len(names) * len(numbered), initial=len(done), unit="plan") as bar:
        for part in parts:
            for planner in part.planners:
                there = set(done.instance[done.planner == planner.name])
                missing = [n for n in range(part.first, part.first + len(part.instances)) if n not in there]
                if not missing:
                    continue
                bar.set_description(planner.name)
                planner.plan(part.instances.batch(slice(0, 1)))
                for number, plan, cpu_s in _plans(planner, part, step, set(missing)):
                    yield _row(part, planner.name, number, numbered[number], plan, timing, cpu_s)
                    bar.update()


def check_done(done: pd.DataFrame, names: list[str], problems: Mapping[int, Problem], timing: Timing) -> None:
    """Refuse rows that these planners, numbered instances and timing cannot have made."""
    known = done.planner.isin(names) & (done.timing == timing)
    scenes = {number: _scene(problem) for number, problem in problems.items()} if len(done) else {}
    for column in ("n_obstacles", "obstacles", "target"):
        known &= done[column] == done.instance.map({number: scene[column] for number, scene in scenes.items()})
    if not known.all():
        one = done[~known].iloc[0]
        raise InputError(f"rows: that of {one.planner} on instance {one.instance} is from another evaluation")


def _plans(planner: Planner, part: Part, step: int, missing: Container[int]) -> Iterator[tuple[int, Plan, float]]:
    """The number, the plan and the share of the CPU seconds of each instance that is missing."""
    for start in range(0, len(part.instances), step):
        batch: Batch = part.instances.batch(slice(start, start + step))
        numbers = range(part.first + start, part.first + start + len(batch.target))
        if not any(number in missing for number in numbers):
            continue
        began = time.process_time()
        plans = planner.plan(batch)
        share = (time.process_time() - began) / len(plans)
        for number, plan in zip(numbers, plans, strict=True):
            if number in missing:
                yield number, plan, share


def _row(part: Part, planner: str, number: int, problem: Problem, plan: Plan, timing: Timing, cpu_s: float) -> Row:
    """The row of one instance."""
    row = row_of(planner, number, problem, plan, timing)
    if not part.about:
        return row
    about = part.about[number - part.first]
    _check_proof(f"{planner}, instance {number}", plan, about["optimum"])
    return BenchmarkRow(**vars(row), **about, cpu_s=cpu_s)


def _check_proof(where: str, plan: Plan, optimum: int | None) -> None:
    """Refuse what contradicts a proved optimum; None: there is no plan."""
    if plan.status is Status.SOLVED and (optimum is None or len(plan.moves) < optimum):
        raise PlanError(f"{where}: a plan of {len(plan.moves)} moves, and {optimum or 'none'} is the proved optimum")
    if (plan.status is Status.UNSOLVABLE and optimum is not None) or plan.optimal_moves not in (None, optimum):
        raise PlanError(f"{where}: proved {plan.status} with {plan.optimal_moves} moves, and {optimum} is the optimum")


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
