"""Rows: one an instance and planner, honest about what was timed, and proved."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from dore.errors import InputError
from dore.planners.straight_line import StraightLine
from dore.report.evaluation import Timing, evaluate, read_rows, write_rows
from dore.world.generator import Difficulty
from dore.world.instances import InstanceSet
from dore.world.plan import Plan, PlanError, Status
from dore.world.problem import Batch
from tests.drawings import wide_hand

REACH = wide_hand(4, 5)
INSTANCES = InstanceSet.generate(REACH, 25, Difficulty(3, 8), "test", seed=0)


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


def test_one_row_an_instance_and_planner() -> None:
    rows = evaluate([baseline("a"), baseline("b")], INSTANCES, progress=False)
    assert [(row.planner, row.instance) for row in rows] == [(p, n) for p in "ab" for n in range(1, 26)]
    plans = baseline().plan(INSTANCES.batch())
    for row, plan, problem in zip(rows, plans, INSTANCES, strict=False):
        assert (row.status, row.reason, row.moves) == (plan.status, plan.reason, len(plan.moves))
        assert (row.n_cells, row.n_obstacles) == (20, len(problem.scene.obstacles))
        assert row.planning_s > 0


def test_timing_says_how_many_were_planned_together() -> None:
    single, batched = Recording(), Recording()
    alone = evaluate([single], INSTANCES, progress=False)
    together = evaluate([batched], INSTANCES, Timing.BATCHED, batch_size=10, progress=False)
    # The first of each is the untimed warm-up.
    assert single.sizes == [1] + [1] * 25
    assert batched.sizes == [1, 10, 10, 5]
    assert {row.timing for row in alone} == {Timing.SINGLE}
    assert {row.timing for row in together} == {Timing.BATCHED}
    assert [row.moves for row in alone] == [row.moves for row in together]


def test_a_plan_that_does_not_replay_is_no_row() -> None:
    with pytest.raises(PlanError, match=r"straight_line, instance \d+: "):
        evaluate([Lying(REACH, 0.0, 0.0, None, False, 30)], INSTANCES, progress=False)


def test_two_planners_of_one_name_are_refused() -> None:
    with pytest.raises(InputError, match="want different names"):
        evaluate([baseline(), baseline()], INSTANCES, progress=False)


def test_rows_come_back_from_the_file(tmp_path: Path) -> None:
    rows = evaluate([baseline()], INSTANCES, progress=False)
    assert {row.status for row in rows} == {Status.SOLVED, Status.GAVE_UP}
    path = tmp_path / "rows.csv"
    write_rows(path, rows)
    assert [replace(row, planning_s=0.0) for row in read_rows(path)] == [replace(row, planning_s=0.0) for row in rows]
    for there, here in zip(read_rows(path), rows, strict=True):
        assert there.planning_s == pytest.approx(here.planning_s, abs=1e-9)


def test_a_bad_file_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "rows.csv"
    with pytest.raises(InputError, match="no such file"):
        read_rows(path)
    write_rows(path, evaluate([baseline()], INSTANCES, progress=False))
    text = path.read_text()
    for damaged, why in (
        (text.replace("expansions", "boards"), "columns"),
        (text.replace("solved", "sloved"), r"line \d+: 'sloved'"),
        (text.rsplit(",", 3)[0], "line 26: "),
        ("", "columns None"),
    ):
        path.write_text(damaged)
        with pytest.raises(InputError, match=why) as error:
            read_rows(path)
        assert "\n" not in str(error.value)
