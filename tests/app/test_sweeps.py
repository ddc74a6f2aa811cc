"""Sweeps: one folder per job, what is finished is skipped, what broke is named, and each launcher runs."""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

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


def until(there, seconds: float = 300) -> None:
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


@pytest.mark.slow
def test_one_broken_job_is_named_and_the_others_finish(tmp_path, capsys):
    """Bad input, a loss that is no longer finite, and a good one, side by side."""
    more = ["optimizer.lr=-1,10,0.001", "training.learning_starts=100", "checkpoint_minutes=0.00001"]
    more += ["optimizer._target_=tests.app.diverging.Diverging"]
    assert run("train", ["-m", *TINY, SERIAL, *more, f"hydra.sweep.dir={tmp_path}"]) == 2
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


def test_a_key_that_one_job_does_not_know_stops_the_sweep_before_it_starts(tmp_path, capsys):
    options = [*TINY, SERIAL, f"hydra.sweep.dir={tmp_path}", "agent=single,sequential", "agent.n_slots=9"]
    assert run("train", ["-m", *options]) == 2
    assert capsys.readouterr().err.splitlines()[-1].startswith("dore-train: agent.n_slots: no such key")
    assert not list(tmp_path.glob("*/*"))


@pytest.mark.slow
def test_a_sweep_again_skips_resumes_and_starts_over(tmp_path, capsys):
    arguments = ["-m", *TINY, SERIAL, "seed=0,1,2", f"hydra.sweep.dir={tmp_path}"]
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


@pytest.mark.slow
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
