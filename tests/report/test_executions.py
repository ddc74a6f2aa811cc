"""Many executions and their pages: done once, skipped the next time, and counted from their reports alone."""

from __future__ import annotations

import json
import shutil

import pandas as pd
import pytest

from dore.errors import InputError
from dore.report import frame, results
from scripts import bench_execution, executions
from scripts.program import run
from tests.report.fakes import study

pytestmark = pytest.mark.sim


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("executions")
    for planner in ("straight_line", "learned"):
        carry_out(out, planner)
    return out


def carry_out(out, planner, *more):
    small = ("obstacles=[3]", "runs=2", "workers=1", "solved_by=[straight_line,learned]")
    words = [f"out={out / planner}", *small, f"planner={planner}", *more]
    return run(executions.main, executions.Options, words)


def test_reports_lie_where_they_are_looked_for(folder):
    rows = frame.executions(folder, "{planner}/z{column}/{instance}").rows
    mine = rows[rows.planner == "learned"]
    assert list(zip(mine.column, mine.instance, strict=True)) == [(3, "000"), (3, "001")]
    assert (mine.success & ~mine.refused).all()
    assert (mine.grasp_margin_mm > 0).all()
    assert (mine.simulated_s > 3).all()


def test_what_is_done_is_skipped_and_what_is_not_finished_is_not(folder, capsys):
    path = folder / "learned" / "z3" / "000" / "execution.json"
    before = json.loads(path.read_text())
    path.write_text(json.dumps({**before, "finished": False}))
    assert carry_out(folder, "learned") == 0
    assert "1 of 2 executions are done" in capsys.readouterr().out
    again = json.loads(path.read_text())
    assert again["finished"]
    assert again["moves"][0]["placement_error_mm"] == before["moves"][0]["placement_error_mm"]


def test_the_page_counts_runs_and_names_those_that_failed(folder, tmp_path):
    spec, runs = study("execution"), tmp_path / "runs"
    shutil.copytree(folder / "straight_line", runs / "open")
    path = runs / "open" / "z3" / "001" / "execution.json"
    page = results.write_page(spec, "execution", runs, tmp_path).read_text(encoding="utf-8")
    assert "## Open loop" in page
    assert "Every run succeeded." in page
    assert len(pd.read_csv(tmp_path / "execution.csv")) == 2
    report = json.loads(path.read_text())
    path.write_text(json.dumps({**report, "success": False, "outcome": "dropped", "message": "lost it"}))
    page = results.write_page(spec, "execution", runs, tmp_path).read_text(encoding="utf-8")
    assert "3 obstacles, run 001: dropped: lost it" in page
    assert "| all | 2 | 0 | 50.0 [" in page


def test_execution_time_compares_the_same_scenes(folder, tmp_path):
    page = results.write_page(study("execution_time"), "execution_time", folder, tmp_path).read_text(encoding="utf-8")
    assert "2 scenes carried out by both; 0 left out" in page
    assert "| paper: baseline | 170 (48) |" in page
    assert (tmp_path / "execution_time.png").stat().st_size > 1000


def test_a_folder_holds_executions_of_one_kind(folder, capsys):
    assert carry_out(folder, "learned", "seed=8") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "holds executions of another kind" in line
    assert carry_out(folder, "learned", "loop=round") == 2
    assert "loop: got 'round', want one of open, closed" in capsys.readouterr().err


def test_too_few_scenes_are_bad_input():
    with pytest.raises(InputError, match=r"runs: 20, but only 10 of 10"):
        executions.solvable_scenes(["exact"], 3, 20, 10, 7)


@pytest.mark.slow
def test_the_speed_page_is_made(tmp_path):
    assert run(bench_execution.main, bench_execution.Options, [f"out={tmp_path}", "plans=1"]) == 0
    spec, docs = study("execution_speed"), tmp_path / "docs"
    page = results.write_page(spec, "execution_speed", tmp_path, docs).read_text(encoding="utf-8")
    assert "simulated control steps a second" in page
    assert "| inverse kinematics |" in page
    assert "| 2 | 2 |" in page
    assert "nan" not in page
