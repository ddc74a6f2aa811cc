"""An evaluation that was stopped or killed is resumed, and ends as one that was not."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from dore.errors import InputError
from dore.files import ROWS_FILE
from dore.planners.straight_line import StraightLine
from dore.report.evaluation import PARTIAL, evaluate_into
from dore.report.rows import Row, Timing, read_rows, write_rows
from dore.world.generator import Difficulty
from dore.world.instances import InstanceSet
from dore.world.plan import Plan, Status
from dore.world.problem import Batch
from tests.commands import ctrl_c_at_plan, run
from tests.drawings import wide_hand

REACH = wide_hand(4, 5)
INSTANCES = InstanceSet.generate(REACH, 12, Difficulty(3, 8), "test", seed=0)
WORLD = ("layout=3x6", "reach=wide_hand", "instances=z3-5", "limit=10", "planner=[straight_line,exact]")


class Stopping(StraightLine):
    """Is stopped in its `last` call."""

    def __init__(self, name: str, last: int = 1000) -> None:
        super().__init__(REACH, 0.0, 0.0, None, False, 30)
        self.name, self.left = name, last

    def plan(self, batch: Batch) -> list[Plan]:
        self.left -= 1
        if self.left == 0:
            raise KeyboardInterrupt
        return super().plan(batch)


def untimed(rows: pd.DataFrame) -> list[tuple[object, ...]]:
    return list(rows.drop(columns="planning_s").itertuples(index=False, name=None))


@pytest.mark.parametrize("timing", list(Timing))
def test_stopped_and_resumed_equals_uninterrupted(tmp_path: Path, timing: Timing) -> None:
    """Stopped in the second planner's fifth instance, or in its only batch, and once more with a line cut off."""
    last = 6 if timing is Timing.SINGLE else 2
    with pytest.raises(KeyboardInterrupt):
        evaluate_into(tmp_path, [Stopping("a"), Stopping("b", last)], INSTANCES, timing)
    assert not (tmp_path / ROWS_FILE).exists()
    there = read_rows(tmp_path / PARTIAL)
    assert list(there.planner) == ["a"] * 12 + ["b"] * (4 if timing is Timing.SINGLE else 0)
    with open(tmp_path / PARTIAL, "a", encoding="utf-8") as file:
        file.write("b,9,20,4,solv")
    evaluate_into(tmp_path, [Stopping("a", last=1), Stopping("b")], INSTANCES, timing)
    rows = read_rows(tmp_path / ROWS_FILE)
    assert rows[: len(there)].equals(there), "what is there is not planned again"
    assert [path.name for path in tmp_path.iterdir()] == [ROWS_FILE]
    evaluate_into(tmp_path, [Stopping("a"), Stopping("b")], INSTANCES, timing)
    assert untimed(rows) == untimed(read_rows(tmp_path / ROWS_FILE))


def test_a_batch_of_which_a_row_is_missing_is_planned_whole(tmp_path: Path) -> None:
    evaluate_into(tmp_path, [Stopping("a")], INSTANCES, Timing.BATCHED, 5)
    lines = (tmp_path / ROWS_FILE).read_text(encoding="utf-8").splitlines(keepends=True)
    (tmp_path / PARTIAL).write_text("".join(lines[:8]), encoding="utf-8")
    sizes: list[int] = []

    class Recording(Stopping):
        def plan(self, batch: Batch) -> list[Plan]:
            sizes.append(len(batch.target))
            return super().plan(batch)

    whole = read_rows(tmp_path / ROWS_FILE)
    evaluate_into(tmp_path, [Recording("a")], INSTANCES, Timing.BATCHED, 5)
    assert sizes == [1, 5, 2], "the untimed one, the second batch, the third"
    assert untimed(read_rows(tmp_path / ROWS_FILE)) == untimed(whole)


@pytest.mark.parametrize(
    "change", [{"planner": "z"}, {"instance": 13}, {"instance": 0}, {"n_obstacles": 19}, {"timing": Timing.BATCHED}]
)
def test_rows_of_another_evaluation_are_refused(tmp_path: Path, change: dict) -> None:
    row = Row("a", 1, 20, len(next(iter(INSTANCES)).scene.obstacles), Status.SOLVED, "", 1, 0.1, 0, Timing.SINGLE)
    write_rows(tmp_path / PARTIAL, [replace(row, **change)])
    with pytest.raises(InputError, match="is from another evaluation"):
        evaluate_into(tmp_path, [Stopping("a")], INSTANCES, Timing.SINGLE)


def test_ctrl_c_says_how_to_resume(tmp_path: Path, capsys) -> None:
    assert run("evaluate", [*WORLD, f"run_dir={tmp_path / 'whole'}"]) == 0
    with ctrl_c_at_plan(5):
        assert run("evaluate", [*WORLD, f"run_dir={tmp_path / 'parts'}"]) == 130
    assert f"resume with: dore-evaluate resume={tmp_path / 'parts'}" in capsys.readouterr().out
    assert len(read_rows(tmp_path / "parts" / PARTIAL)) == 3
    # The second time there is nothing left to do but to show the tables.
    for _ in range(2):
        assert run("evaluate", [f"resume={tmp_path / 'parts'}"]) == 0
        assert "timing=single, threads=1" in capsys.readouterr().out
    whole, parts = (read_rows(tmp_path / name / ROWS_FILE) for name in ("whole", "parts"))
    assert untimed(whole) == untimed(parts)


def test_a_killed_evaluation_is_resumed(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    code = "from dore.app.cli import evaluate; evaluate()"
    overrides = [*WORLD, "limit=2000", "planner=exact", f"run_dir={folder}"]
    process = subprocess.Popen([sys.executable, "-c", code, *overrides], stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 90
    while time.monotonic() < deadline and (not (folder / PARTIAL).exists() or (folder / PARTIAL).stat().st_size < 900):
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait(60)
    kept = (folder / PARTIAL).read_text(encoding="utf-8")
    kept = kept[: kept.rfind("\n") + 1]
    assert run("evaluate", [f"resume={folder}"]) == 0
    assert (folder / ROWS_FILE).read_text(encoding="utf-8").startswith(kept)
    assert len(read_rows(folder / ROWS_FILE)) == 2000


@pytest.mark.parametrize(
    ("more", "says"),
    [(["limit=3"], "limit=3 cannot be changed in"), (["resume=/nowhere"], "/nowhere is no run folder")],
)
def test_bad_resume(tmp_path: Path, capsys, more: list[str], says: str) -> None:
    assert run("evaluate", [*WORLD, "planner=straight_line", f"run_dir={tmp_path / 'run'}"]) == 0
    capsys.readouterr()
    assert run("evaluate", [f"resume={tmp_path / 'run'}", *more]) == 2
    assert says in capsys.readouterr().err


def test_the_config_names_the_world_that_was_evaluated(tmp_path: Path) -> None:
    """Also where it is the model's, so that rows can be told apart later."""
    small = ["instances.test_size=20", "instances.validation_size=20", "ipt.batch_size=20", "training.max_episodes=16"]
    assert run("train", [*small, "logger=none", f"run_dir={tmp_path / 'train'}"]) == 0
    model = f"model={tmp_path / 'train'}"
    arm = ["reach=panda_slim", "planner=straight_line", "limit=2"]
    assert run("evaluate", [model, *arm, f"run_dir={tmp_path / 'run'}"]) == 0
    text = (tmp_path / "run" / "config.yaml").read_text(encoding="utf-8")
    assert all(key in text for key in ("rows: 3", "front_m: 0.5", "clearance_m: 0.1", "max_obstacles: 7"))
