"""Many executions and their pages: done once, skipped the next time, and counted from their reports alone."""

from __future__ import annotations

import csv
import json

import pytest

from dore.errors import InputError
from scripts import bench_execution, execution_report, execution_time, executions

pytestmark = pytest.mark.sim


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("executions")
    arguments = ["--obstacles", "3", "--runs", "2", "--workers", "1", "--solved-by", "straight_line,learned"]
    for planner in ("straight_line", "learned"):
        executions.main([str(out / planner), *arguments, "--planner", planner])
    return out


def test_reports_lie_where_they_are_looked_for(folder):
    runs = list(execution_report.read("open", folder / "learned"))
    assert [(run.obstacles, run.number) for run in runs] == [(3, "000"), (3, "001")]
    assert all(run.success and not run.refused for run in runs)
    assert all(run.grasp_margin_mm > 0 and run.simulated_s > 3 for run in runs)


def test_what_is_done_is_skipped_and_what_is_not_finished_is_not(folder, capsys):
    path = folder / "learned" / "z3" / "000" / "execution.json"
    before = json.loads(path.read_text())
    path.write_text(json.dumps({**before, "finished": False}))
    arguments = ["--obstacles", "3", "--runs", "2", "--workers", "1", "--solved-by", "straight_line,learned"]
    executions.main([str(folder / "learned"), *arguments, "--planner", "learned"])
    assert "1 of 2 executions are done" in capsys.readouterr().out
    again = json.loads(path.read_text())
    assert again["finished"]
    assert again["moves"][0]["placement_error_mm"] == before["moves"][0]["placement_error_mm"]


def test_the_page_counts_runs_and_names_those_that_failed(folder, tmp_path):
    execution_report.main(tmp_path / "page", "a command", {"One": folder / "learned", "Two": folder / "straight_line"})
    page = (tmp_path / "page.md").read_text()
    assert "## One" in page
    assert "Every run succeeded." in page
    with (tmp_path / "page.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 4
    path = folder / "straight_line" / "z3" / "001" / "execution.json"
    report = json.loads(path.read_text())
    path.write_text(json.dumps({**report, "success": False, "outcome": "dropped", "message": "lost it"}))
    execution_report.main(tmp_path / "page", "a command", {"Two": folder / "straight_line"})
    assert "3 obstacles, run 001: dropped: lost it" in (tmp_path / "page.md").read_text()
    path.write_text(json.dumps(report))


def test_execution_time_compares_the_same_scenes(folder, tmp_path):
    execution_time.main(tmp_path / "time", folder / "straight_line", folder / "learned")
    page = (tmp_path / "time.md").read_text()
    assert "| paper: baseline | 170 (48) |" in page
    assert "| paper | 60.2 | 36.6 |" in page
    assert (tmp_path / "time.png").stat().st_size > 1000
    with pytest.raises(InputError, match="not of the same scenes"):
        execution_time.main(tmp_path / "time", folder / "straight_line", folder / "none")


def test_too_few_scenes_are_bad_input():
    with pytest.raises(InputError, match=r"--runs: 20, but only 10 of 10"):
        executions.solvable_scenes(["exact"], 3, 20, 10, 7)


@pytest.mark.slow
def test_the_speed_page_is_made(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr("sys.argv", ["bench_execution", "--plans", "1", "--out", str(tmp_path / "speed.md")])
    bench_execution.main()
    page = (tmp_path / "speed.md").read_text()
    assert "simulated control steps a second" in page
    assert "| inverse kinematics |" in page
