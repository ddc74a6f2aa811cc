"""dore-evaluate on the benchmark: its rows and tables, resuming, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

import dore
from dore.files import ROWS_FILE
from dore.planners.straight_line import StraightLine
from dore.report.evaluation import PARTIAL, benchmark_rows
from dore.report.rows import ROW_COLUMNS, Timing
from dore.world.plan import PlanError
from tests.commands import run
from tests.world.test_benchmark import part

SMALL = ("instances=benchmark", "instances.layouts=[3x6,6x6]", "instances.densities=[50]", "limit=2")


def test_rows_tables_and_resuming(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "run"
    assert run("evaluate", [*SMALL, "planner=[win_else_random,exact]", "timing=batched", f"run_dir={folder}"]) == 0
    text = capsys.readouterr().out
    rows = pd.read_csv(folder / ROWS_FILE)
    assert len(rows) == 2 * 2 * 2 * 7 * 2, "planners, layouts, reaches, strata, boards"
    exact = rows[rows.planner == "exact"]
    assert list(exact.instance) == list(range(1, 57))
    solvable = exact[exact.stratum != "unsolvable"]
    assert (solvable.moves == solvable.optimum).all()
    assert (exact[exact.stratum == "unsolvable"].status == "unsolvable").all()
    assert exact[exact.stratum == "unsolvable"].optimum.isna().all()
    assert set(exact.density) == {50}
    assert set(exact.reach) == {"wide_hand", "paper_fit"}
    assert set(exact.layout.str[:5]) == {"3 x 6", "6 x 6"}
    lines = [line.split() for line in text.splitlines()]
    assert ["exact", *["100.0"] * 7] in lines
    assert ["exact", *["1.000"] * 7] in lines
    assert [line[-1] for line in lines if line[:2] == ["exact", "56"]] == ["batched"]

    whole = (folder / ROWS_FILE).read_text(encoding="utf-8").splitlines(keepends=True)
    (folder / ROWS_FILE).unlink()
    (folder / PARTIAL).write_text("".join(whole[:31]) + "exact,", encoding="utf-8")
    assert run("evaluate", [f"resume={folder}"]) == 0
    again = pd.read_csv(folder / ROWS_FILE)
    assert again.drop(columns=["planning_s", "cpu_s"]).equals(rows.drop(columns=["planning_s", "cpu_s"]))
    assert capsys.readouterr().out.splitlines()[:3] == text.splitlines()[:3]

    row = exact[(exact.reach == "paper_fit") & (exact.stratum == "7+")].iloc[-1]
    plan = ["planner=exact", f"scene={folder}", f"instance={row.instance}", f"out={tmp_path / 'plan.json'}"]
    assert run("plan", plan) == 0, "a row's scene is planned under the row's own reach"
    assert f"{row.moves} move" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("override", "why"),
    [
        ("layout=3x6", "layout: has no effect on instances=benchmark, want instances.layouts=[NAME]"),
        ("reach=published", "reach: has no effect on instances=benchmark, want instances.reaches=[NAME]"),
        ("split=validation", "split: got validation, want test: the benchmark has no other boards"),
        ("arm=panda_slim", "instances: got benchmark, want another where an arm carries plans out"),
        ("limit=0", "limit: got 0, want 1 or more"),
        ("instances.sha256=none", "instances.sha256: got 19d1565e"),
    ],
)
def test_what_is_refused(override: str, why: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("evaluate", [*SMALL, override, "planner=exact", f"run_dir={tmp_path / 'run'}"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert why.split(",")[0] in line
    assert not (tmp_path / "run").exists()


def test_it_is_not_trained_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("train", ["instances=benchmark", f"run_dir={tmp_path / 'run'}"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "instances: got benchmark, which is for evaluations" in line


def test_the_python_function_takes_it() -> None:
    rows = dore.evaluate("exact", instances="benchmark", limit=1, timing="batched")
    assert len(rows) > 200
    assert rows[rows.stratum == "7+"].optimum.min() >= 7


def test_plans_that_contradict_a_proof_are_faults() -> None:
    (one,) = part(layouts=["3x6"], reaches=["wide_hand"], densities=[50]).sets(1, "cpu")
    planner = StraightLine(one.instances.reach, 0.0, 0.0, None, False, 30)
    none = pd.DataFrame(columns=list(ROW_COLUMNS))
    wrong = one._replace(about=[{**about, "optimum": 30} for about in one.about])
    with pytest.raises(PlanError, match=r"straight_line, instance 1: a plan of \d+ moves, and 30 is the proved"):
        list(benchmark_rows([wrong], [[planner]], Timing.SINGLE, none))
