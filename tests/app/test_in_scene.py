"""dore-evaluate arm=NAME: plans are carried out, row by row; stopped, resumed, and refused where it cannot be."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil

import pandas as pd
import pytest
import yaml

from dore.app import in_scene
from dore.report import results
from dore.report.rows import read_rows
from dore.sim.scene.agent import render_backend
from tests.app.test_without_simulator import run_without_simulator
from tests.commands import run
from tests.report.fakes import study

pytestmark = pytest.mark.sim
SLIM = ("arm=panda_slim", "planner=[exact,straight_line]", "instances=z3-5")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("scene") / "run"
    assert run("evaluate", [*SLIM, "limit=3", f"run_dir={out}"]) == 0
    return out


def test_each_planner_plans_and_the_arm_carries_out_the_same_scenes(folder):
    rows = read_rows(folder / "rows.csv")
    assert list(zip(rows.instance, rows.planner, strict=True)) == [
        (number, planner) for number in (1, 2, 3) for planner in ("exact", "straight_line")
    ]
    solved = rows[rows.status == "solved"]
    assert (solved.success & solved.claimed).all()
    assert (solved.outcome == "done").all()
    assert (solved.moves_made == solved.moves + 1).all()
    assert (solved.placement_error_mm.dropna() < 10).all()
    assert (solved.simulated_s > 3).all()
    assert (rows.cpu_s > 0).all()


def test_the_reach_is_the_arms_own_and_kept_in_the_config(folder):
    config = yaml.safe_load((folder / "config.yaml").read_text())
    assert config["reach"]["clearance_m"] == 0.1
    assert (config["layout"]["rows"], config["layout"]["cols"], config["layout"]["front_m"]) == (3, 6, 0.5)


def test_the_tables_say_who_succeeds_how_often_and_less_whom(folder, capsys):
    assert run("evaluate", [f"resume={folder}"]) == 0
    said = capsys.readouterr().out
    assert re.search(r"^exact +3 +100\.0 \[43\.9, 100\.0\] +0 +0 +0 +0 ", said, re.MULTILINE)
    assert re.search(r"^exact +\+0\.0 \[-\d", said, re.MULTILINE)
    assert "success less straight_line, points" in said


def test_what_is_lost_in_a_kill_is_made_again_and_is_the_same(folder, tmp_path):
    before, again = read_rows(folder / "rows.csv"), tmp_path / "again"
    shutil.copytree(folder, again)
    os.rename(again / "rows.csv", again / "rows.part.csv")
    lines = (again / "rows.part.csv").read_text().splitlines(keepends=True)
    (again / "rows.part.csv").write_text("".join(lines[:4]) + lines[4][:20])
    assert run("evaluate", [f"resume={again}"]) == 0
    after = read_rows(again / "rows.csv")
    same = ["planner", "instance", "moves", "outcome", "success", "moves_made", "simulated_s"]
    pd.testing.assert_frame_equal(after[same], before[same])
    assert (after.placement_error_mm - before.placement_error_mm).abs().max() < 0.2


@pytest.mark.slow
def test_two_workers_make_the_same_rows(folder, tmp_path):
    assert run("evaluate", [*SLIM, "limit=3", "workers=2", f"run_dir={tmp_path / 'two'}"]) == 0
    one, two = (read_rows(path / "rows.csv") for path in (folder, tmp_path / "two"))
    same = ["planner", "instance", "outcome", "success", "moves_made", "simulated_s"]
    pd.testing.assert_frame_equal(one[same], two[same])


@pytest.mark.skipif(not importlib.util.find_spec("dm_control"), reason="no extra [jaco]: no meshes")
def test_the_jaco_with_kinovas_meshes_is_evaluated_like_the_others(tmp_path):
    jaco, out = ("arm=jaco", "objects=cans", "planner=exact", "instances=z3-5", "limit=1"), tmp_path / "jaco"
    assert run("evaluate", [*jaco, f"run_dir={out}"]) == 0
    (row,) = read_rows(out / "rows.csv").itertuples()
    assert (row.success, row.refused, row.outcome) == (True, False, "done")
    assert yaml.safe_load((out / "config.yaml").read_text())["reach"]["clearance_m"] == 0.141


@pytest.mark.slow
@pytest.mark.skipif(not importlib.util.find_spec("ray"), reason="ray is not installed")
def test_workers_of_a_local_ray_make_the_same_rows(folder, tmp_path):
    assert run("evaluate", [*SLIM, "limit=3", "workers=2", "backend=ray", f"run_dir={tmp_path / 'ray'}"]) == 0
    one, two = (read_rows(path / "rows.csv") for path in (folder, tmp_path / "ray"))
    same = ["planner", "instance", "outcome", "success", "moves_made", "simulated_s"]
    pd.testing.assert_frame_equal(one[same], two[same])


def test_what_goes_wrong_in_an_open_loop_is_no_success(tmp_path):
    out = tmp_path / "slip"
    assert run("evaluate", [*SLIM[:1], "planner=exact", SLIM[2], "limit=1", "disturbance=slip", f"run_dir={out}"]) == 0
    (row,) = read_rows(out / "rows.csv").itertuples()
    assert (row.success, row.claimed, row.faults, row.moves_made) == (False, False, 1, 1)
    assert row.outcome in ("missed_grasp", "dropped")


@pytest.mark.skipif(render_backend() == "none", reason="no Vulkan driver")
def test_a_closed_loop_recovers_and_says_what_disturbed_it(tmp_path):
    out, closed = tmp_path / "closed", ("loop=closed", "disturbance=slip")
    assert run("evaluate", [*SLIM[:1], "planner=exact", SLIM[2], "limit=1", *closed, f"run_dir={out}"]) == 0
    (row,) = read_rows(out / "rows.csv").itertuples()
    assert (row.success, row.claimed, row.faults) == (True, True, 1)
    assert row.plans >= 2


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["loop=closed"], "loop=closed: has no effect unless an arm carries plans out, want arm=NAME too"),
        (["disturbance=slip"], "disturbance=slip: has no effect unless"),
        (
            ["arm=panda_slim", "reach=paper_fit"],
            "reach=paper_fit: plans are made with the arm's own reach, want none given",
        ),
        (["arm=panda_slim", "timing=batched"], "timing: got 'batched', want single where an arm"),
        (["arm=panda_slim", "loop=round"], "loop: got 'round', want open or closed where an arm"),
        (["arm=panda_slim", "backend=dask"], "backend: got 'dask', want loky or ray where an arm"),
        (["arm=panda_slim", "workers=0"], "workers: got 0, want a whole number of 1 or more"),
        (["arm=panda_slim", "seed=-1"], "seed: got -1"),
        (["arm=panda_slim", "layout=8x8"], "layout: cells 25, 26"),
        (["arm=jaco", "arm.urdf=gone"], "arm.urdf: gone: No such file"),
    ],
)
def test_bad_input_is_one_line(overrides, message, tmp_path, capsys):
    assert run("evaluate", [*overrides, f"run_dir={tmp_path / 'run'}"]) == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("dore-evaluate")]
    assert message in line
    assert not (tmp_path / "run").exists()


def test_without_the_simulator_an_arm_names_the_extra(tmp_path):
    done = run_without_simulator("evaluate", "arm=panda_slim", f"run_dir={tmp_path / 'run'}")
    assert done.returncode == 2
    assert re.search(r"needs the simulator, and \w+ is not installed; .*pip install '\.\[sim\]'", done.stderr)


def test_ray_is_named_where_it_is_missing(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "ray", None)
    with pytest.raises(in_scene.InputError, match=r"backend: ray is not installed \(pip install ray\)"):
        in_scene._register("ray")


def test_a_page_of_executions_counts_rows_and_names_those_that_failed(folder, tmp_path):
    spec, runs = study("execution"), tmp_path / "runs"
    shutil.copytree(folder, runs / "open_z5")
    rows = pd.read_csv(runs / "open_z5" / "rows.csv", keep_default_na=False)
    rows = rows[rows.planner == "exact"]
    rows.loc[rows.instance == 2, ["success", "outcome", "message"]] = [False, "dropped", "lost it"]
    rows.to_csv(runs / "open_z5" / "rows.csv", index=False)
    page = results.write_page(spec, "execution", runs, tmp_path).read_text(encoding="utf-8")
    assert re.search(r"\d obstacles, scene 2: dropped: lost it", page)
    assert "| all | 3 | 0 | 66.7 [" in page
    assert results.write_page(spec, "execution", None, tmp_path).read_text(encoding="utf-8") == page


def test_execution_time_compares_the_same_scenes(folder, tmp_path):
    shutil.copytree(folder, tmp_path / "runs" / "z3")
    spec = study("execution_time")
    page = results.write_page(spec, "execution_time", tmp_path / "runs", tmp_path).read_text(encoding="utf-8")
    assert "3 scenes carried out by both; 0 left out" in page
    assert "| paper: baseline | 170 (48) |" in page
