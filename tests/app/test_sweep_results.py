"""What a sweep is called, what is refused before it starts, and the result that it ends in."""

from __future__ import annotations

import json

import pandas as pd
import pytest

from dore.app import sweep_job
from tests.app.test_sweeps import SERIAL, folders
from tests.commands import TINY, complaints, run


@pytest.mark.parametrize(
    ("overrides", "says"),
    [
        (["seed=0,1,0"], "seed: 0 is given twice, but no two jobs may share a folder"),
        (["training.max_minutes=1,2"], "training.max_minutes: got 1, 2, want one: no job's folder is named after it"),
        (["sweep=null"], "sweep: got None, want a path"),
    ],
)
def test_bad_sweeps_are_one_line(tmp_path, capsys, overrides, says):
    assert run("train", ["-m", *TINY, *overrides, f"hydra.sweep.dir={tmp_path}"]) == 2
    (line,) = complaints(capsys)
    assert says in line
    assert not list(tmp_path.glob("*/config.yaml"))


@pytest.mark.slow
def test_a_named_sweep_and_a_larger_budget(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run("train", ["-m", *TINY, SERIAL, "sweep=mine"]) == 0
    assert run("train", ["-m", *TINY, SERIAL, "sweep=mine", "training.max_episodes=190"]) == 0
    (folder,) = folders(tmp_path / "outputs" / "sweeps" / "mine")
    assert len(folder.name) <= 120
    assert json.loads((folder / "done.json").read_text())["episodes"] >= 190
    assert {path.name for path in tmp_path.iterdir()} == {"outputs"}


def test_names_that_do_not_tell_jobs_apart(tmp_path, capsys):
    """A subdir of the user's own: the second job must not pass for the first, in this start or in the next."""
    arguments = ["-m", *TINY, SERIAL, f"hydra.sweep.dir={tmp_path}", "hydra.sweep.subdir=same"]
    assert run("train", [*arguments, "seed=0,1"]) == 2
    (line,) = complaints(capsys)
    assert "seed=1): its folder is that of" in line
    assert run("train", [*arguments, "seed=0", "training.batch_size=16"]) == 2
    assert "was started with training.batch_size=8, not 16" in capsys.readouterr().err
    assert run("train", [*arguments, "seed=1"]) == 2
    (line,) = complaints(capsys)
    assert line.endswith("same was started with seed=0, not 1")


def test_a_launcher_that_fails_is_one_line(tmp_path, capsys, monkeypatch):
    def gone(cfg):
        raise RuntimeError("a worker\nwas terminated")

    monkeypatch.setattr(sweep_job, "run_job", gone)
    assert run("train", ["-m", *TINY, SERIAL, f"hydra.sweep.dir={tmp_path}"]) == 1
    line = complaints(capsys)[-1]  # Hydra says first which job it was.
    assert line == "dore-train: RuntimeError: a worker was terminated"


def test_a_sweep_ends_in_a_result(tmp_path, capsys):
    arguments = ["-m", *TINY, SERIAL, "agent=single,sequential", "seed=0,1", f"hydra.sweep.dir={tmp_path}"]
    assert run("train", arguments) == 0
    summary = pd.read_csv(tmp_path / "summary.csv")
    done = {path.parent.name: json.loads(path.read_text()) for path in tmp_path.glob("*/done.json")}
    assert list(summary.columns[:4]) == ["job", "agent", "seed", "code"]
    assert {one.job: (one.best_success, one.episodes) for one in summary.itertuples()} == {
        name: (one["best_success"], one["episodes"]) for name, one in done.items()
    }
    table = capsys.readouterr().out.split("over seeds")[1].splitlines()
    for agent in ("single", "sequential"):
        (line,) = [one for one in table if one.startswith(f"agent={agent} ")]
        best = [100 * one["best_success"] for name, one in done.items() if name.startswith(f"agent-{agent}_seed-")]
        assert line.split()[1:3] == ["2", f"{sum(best) / 2:.1f}"]
        assert f"[{min(best):.1f}, {max(best):.1f}]" in line
    assert (tmp_path / "learning_curves.png").stat().st_size > 10_000
