"""Rows: one an instance and planner, honest about what was timed, and proved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from dore.errors import InputError
from dore.files import ROWS_FILE
from dore.planners.base import Planner
from dore.planners.straight_line import StraightLine
from dore.report.evaluation import evaluate_into
from dore.report.rows import Timing, read_rows
from dore.world.generator import Difficulty
from dore.world.instances import InstanceSet
from dore.world.plan import Plan, PlanError
from dore.world.problem import Batch
from tests.drawings import wide_hand

REACH = wide_hand(4, 5)
INSTANCES = InstanceSet.generate(REACH, 25, Difficulty(3, 8), "test", seed=0)


def evaluated(folder: Path, planners: Sequence[Planner], timing: Timing = Timing.SINGLE, size: int = 9) -> pd.DataFrame:
    folder.mkdir(exist_ok=True)
    evaluate_into(folder, planners, INSTANCES, timing, size)
    return read_rows(folder / ROWS_FILE)


def baseline(name: str = "straight_line") -> StraightLine:
    planner = StraightLine(REACH, 0.0, 0.0, None, False, 30)
    planner.name = name
    return planner


class Recording(StraightLine):
    """Notes how many instances it was given at a time."""

    def __init__(self) -> None:
        super().__init__(REACH, 0.0, 0.0, None, False, 30)
        self.sizes: list[int] = []

    def plan(self, batch: Batch) -> list[Plan]:
        self.sizes.append(len(batch.target))
        return super().plan(batch)


class Lying(StraightLine):
    """Leaves out its first move."""

    def plan(self, batch: Batch) -> list[Plan]:
        return [replace(plan, moves=plan.moves[1:]) for plan in super().plan(batch)]


def test_one_row_an_instance_and_planner(tmp_path: Path) -> None:
    rows = evaluated(tmp_path, [baseline("a"), baseline("b")])
    assert list(zip(rows.planner, rows.instance, strict=True)) == [(p, n) for p in "ab" for n in range(1, 26)]
    assert set(rows.status) == {"solved", "gave_up"}
    plans = baseline().plan(INSTANCES.batch())
    for row, plan, problem in zip(rows.itertuples(), plans, INSTANCES, strict=False):
        assert (row.status, row.reason, row.moves) == (plan.status, plan.reason, len(plan.moves))
        assert (row.n_cells, row.n_obstacles) == (20, len(problem.scene.obstacles))
        assert row.planning_s > 0


def test_timing_says_how_many_were_planned_together(tmp_path: Path) -> None:
    single, batched = Recording(), Recording()
    alone = evaluated(tmp_path / "a", [single])
    together = evaluated(tmp_path / "b", [batched], Timing.BATCHED, 10)
    # The first of each is the untimed warm-up.
    assert single.sizes == [1] + [1] * 25
    assert batched.sizes == [1, 10, 10, 5]
    assert set(alone.timing) == {"single"}
    assert set(together.timing) == {"batched"}
    assert list(alone.moves) == list(together.moves)


def test_a_plan_that_does_not_replay_is_no_row(tmp_path: Path) -> None:
    with pytest.raises(PlanError, match=r"straight_line, instance \d+: "):
        evaluated(tmp_path, [Lying(REACH, 0.0, 0.0, None, False, 30)])


def test_two_planners_of_one_name_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="want different names"):
        evaluated(tmp_path, [baseline(), baseline()])


def test_a_bad_file_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / ROWS_FILE
    with pytest.raises(InputError, match="no such file"):
        read_rows(path)
    evaluated(tmp_path, [baseline()])
    text = path.read_text()
    for damaged, why in (
        (text.replace("expansions", "boards"), "no column expansions"),
        (text.replace("solved", "sloved"), r"line \d+: status 'sloved', want one of solved"),
        (text.rsplit(",", 6)[0], "line 26: timing ''"),
        (text.rsplit(",", 1)[0], "line 26: a value is missing"),
        (text.replace(",20,", ",,", 1), "line 2: a value is missing"),
        (text.replace("\nstraight_line,2,", "\nstraight_line,1,"), "straight_line has two rows of instance 1"),
        ("", "cannot be read as CSV"),
    ):
        path.write_text(damaged)
        with pytest.raises(InputError, match=why) as error:
            read_rows(path)
        assert "\n" not in str(error.value)


def test_contradicting_proofs_are_refused(tmp_path: Path) -> None:
    rows = evaluated(tmp_path, [baseline()])
    one = rows[rows.status == "solved"].iloc[0]
    line = f"exact,{one.instance},20,{one.n_obstacles},unsolvable,,0,0.1,5,single,,,{one.target}\n"
    with (tmp_path / ROWS_FILE).open("a") as file:
        file.write(line)
    with pytest.raises(
        InputError, match=f"straight_line solved instance {one.instance}, and exact proved it unsolvable"
    ):
        read_rows(tmp_path / ROWS_FILE)
