"""Sweeps: one folder per job, what is finished is skipped, what broke is named, and each launcher runs."""

from __future__ import annotations

import fcntl
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest

from dore.app import sweep, sweep_job
from tests.commands import TINY, complaints, run

SERIAL = "hydra/launcher=basic"
"""One job after another, in this process: what a test replaces is replaced for the jobs' supervisor too."""
LONG = [
    *(one for one in TINY if not one.startswith("training.max_episodes")),
    "checkpoint_minutes=0.003",
    "training.min_episodes=1000000",
]
"""A run that does not end by itself; how many episodes it may play is said where it is used."""


def outcomes(folder: Path) -> dict[str, sweep.JobResult]:
    """How each job of a sweep ended, by the end of its overrides."""
    return {" ".join(one.overrides[len(TINY) :]): one for one in sweep.results(folder)}


def folders(root: Path) -> list[Path]:
    return sorted(path.parent for path in root.glob("*/config.yaml"))


def until(there, seconds: float = 90) -> None:
    """Wait for something that another process makes."""
    deadline = time.monotonic() + seconds
    while not there():
        assert time.monotonic() < deadline
        time.sleep(0.1)


def start(root: Path, *more: str) -> subprocess.Popen[bytes]:
    """A sweep of two long jobs in a process of its own, once both have left a checkpoint."""
    arguments = ["-m", *LONG, "training.max_episodes=1000000", "seed=0,1", f"hydra.sweep.dir={root}", *more]
    process = subprocess.Popen([sys.executable, "-c", "from dore.app.cli import train; train()", *arguments])
    until(lambda: len(list(root.glob("*/checkpoint.pt"))) == 2)
    return process


def test_one_broken_job_is_named_and_the_others_finish(tmp_path, capsys):
    """Bad input, a loss that is no longer finite, and a good one, side by side."""
    more = ["optimizer.lr=-1,10,0.001", "training.learning_starts=100", "checkpoint_minutes=0.00001"]
    more += ["optimizer._target_=tests.app.diverging.Diverging"]
    assert run("train", ["-m", *TINY, *more, f"hydra.sweep.dir={tmp_path}"]) == 2
    bad, diverged = sorted(complaints(capsys), key=lambda line: "the loss is" in line)
    assert "broken: " in bad
    assert "optimizer.lr=-1 " in bad
    assert bad.endswith("optimizer.lr: got -1, want a finite number above 0 and at most 10")
    assert "no longer finite" in diverged or "the loss is" in diverged
    checkpoint = diverged.split("the last good checkpoint is ")[1]
    assert Path(checkpoint).exists()
    (done,) = tmp_path.glob("*/done.json")
    (good,) = [one for one in outcomes(tmp_path).values() if one.code == 0]
    assert done.parent == Path(good.folder)
    assert not [
        path for path in tmp_path.iterdir() if path.is_dir() and path.name != sweep.JOBS and not any(path.iterdir())
    ]


def test_a_sweep_again_skips_resumes_and_starts_over(tmp_path, capsys):
    arguments = ["-m", *TINY, "seed=0,1,2", f"hydra.sweep.dir={tmp_path}"]
    assert run("train", arguments) == 0
    finished, stopped, young = (tmp_path / Path(outcomes(tmp_path)[f"seed={seed}"].folder).name for seed in range(3))
    before = (finished / "metrics.csv").stat().st_mtime_ns
    (stopped / "done.json").unlink()  # as if killed after its last checkpoint
    for name in ("done.json", "checkpoint.pt"):
        (young / name).unlink()  # as if killed before its first
    rows = (stopped / "metrics.csv").read_text()
    started = (young / "about.json").stat().st_mtime_ns
    assert run("train", arguments) == 0
    assert "3 jobs done (1 of them before), 0 broken" in capsys.readouterr().out
    assert (finished / "metrics.csv").stat().st_mtime_ns == before
    assert (stopped / "metrics.csv").read_text().startswith(rows[: rows.rindex("\n", 0, -1)])
    assert (young / "about.json").stat().st_mtime_ns > started
    assert len(list(tmp_path.glob("*/done.json"))) == 3


def test_ctrl_c_leaves_checkpoints_and_a_second_sweep_is_refused(tmp_path, capsys):
    root = tmp_path / "sweep"
    process = start(root)
    assert run("train", ["-m", *LONG, "seed=3", f"hydra.sweep.dir={root}"]) == 2
    assert capsys.readouterr().err == f"dore-train: sweep: {root} is in use by another process\n"
    process.send_signal(signal.SIGINT)
    assert process.wait(60) == 130
    assert {one.code for one in outcomes(root).values()} == {130}
    # Fewer episodes than were played: what is left to do is to conclude.
    assert run("train", ["-m", *LONG, "training.max_episodes=50", "seed=0,1", f"hydra.sweep.dir={root}"]) == 0
    assert len(list(root.glob("*/done.json"))) == 2
    assert sweep.SWEEPING not in os.environ


def test_jobs_do_not_outlive_their_sweep(tmp_path):
    """The sweep's process is killed: the jobs stop by themselves, each with a checkpoint, and leave no process."""
    process = start(tmp_path)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    if not children.exists():
        pytest.skip("only Linux lists a process's children")
    workers = [Path(f"/proc/{pid}") for pid in children.read_text(encoding="utf-8").split()]
    assert len(workers) >= 2
    process.kill()
    process.wait(60)
    logs = list((tmp_path / sweep.JOBS).glob("*.log"))
    assert len(logs) == 2

    def free(log: Path) -> bool:
        with log.open("ab") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return False
        return True

    until(lambda: all(map(free, logs)), 60)
    until(lambda: not any(worker.exists() for worker in workers), 60)
    assert all("stopped; resume with" in log.read_text() for log in logs)


def test_a_killed_job_takes_no_other_with_it(tmp_path, capsys, monkeypatch):
    def wait_for_the_first_to_be_killed(process, job, stop):
        monkeypatch.undo()
        process.kill()
        process.wait()
        return False

    monkeypatch.setattr(sweep_job, "_wait", wait_for_the_first_to_be_killed)
    assert run("train", ["-m", *TINY, SERIAL, "seed=0,1", f"hydra.sweep.dir={tmp_path}"]) == 1
    (line,) = complaints(capsys)
    assert "seed=0): killed by SIGKILL, as a system does that runs out of memory" in line
    assert len(list(tmp_path.glob("*/done.json"))) == 1


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
