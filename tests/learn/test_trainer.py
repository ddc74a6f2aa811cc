"""Algorithm 2: it learns, the same seed gives the same run, and a resumed run is the uninterrupted one."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time
from itertools import pairwise

import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from dore.app import session
from dore.errors import InputError
from dore.learn.budget import Budget, LinearEpsilon
from dore.learn.checkpoint import load_checkpoint, load_model, tested_of
from dore.learn.evaluator import TestResult
from dore.learn.learner import Learner
from dore.learn.trainer import Diverged, Trainer
from tests.commands import TINY, run

TIMES = ("seconds", "env_steps_per_s")


def metrics(folder) -> list[dict[str, str]]:
    """The rows of metrics.csv, without what a clock gave."""
    with open(folder / "metrics.csv", encoding="utf-8") as file:
        return [{k: v for k, v in row.items() if k not in TIMES} for row in csv.DictReader(file)]


def same(a: object, b: object) -> bool:
    """Whether two checkpoints' parts are equal, bit for bit."""
    if isinstance(a, torch.Tensor):
        return torch.equal(a, b)
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a if key not in TIMES)
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    return a == b or (a != a and b != b)


@pytest.mark.parametrize("agent", ["sequential", "single"])
def test_same_seed_same_run_and_another_seed_another(tmp_path, agent):
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        assert run("train", [*TINY, f"agent={agent}", f"seed={seed}", f"run_dir={tmp_path / name}"]) == 0
    checkpoints = [load_checkpoint(tmp_path / name / "checkpoint.pt") for name in "abc"]
    assert same(checkpoints[0], checkpoints[1])
    assert not same(checkpoints[0]["learner"]["loss"], checkpoints[2]["learner"]["loss"])
    assert metrics(tmp_path / "a") == metrics(tmp_path / "b")


@pytest.mark.parametrize("train_size", ["null", "30"])
def test_stop_and_resume_equals_uninterrupted(tmp_path, train_size):
    common = [*TINY, f"instances.train_size={train_size}"]
    assert run("train", [*common, f"run_dir={tmp_path / 'whole'}"]) == 0
    assert run("train", [*common, f"run_dir={tmp_path / 'parts'}", "training.max_episodes=70"]) == 0
    assert run("train", [f"resume={tmp_path / 'parts'}", "training.max_episodes=150"]) == 0
    whole, parts = (load_checkpoint(tmp_path / name / "checkpoint.pt") for name in ("whole", "parts"))
    assert same(whole, parts)
    # The short budget's end was tested and logged; that row is the one thing the whole run does not have.
    of_whole, of_parts = metrics(tmp_path / "whole"), metrics(tmp_path / "parts")
    assert [row for row in of_parts if row in of_whole] == of_whole
    assert len(of_parts) == len(of_whole) + 1


@pytest.mark.parametrize("options", [["agent=single"], ["target_update=hard", "agent.chain=literal"]])
def test_interrupt_and_resume_equals_uninterrupted(tmp_path, options, monkeypatch):
    report = session.Session._report

    def interrupted(self, progress, tested):
        report(self, progress, tested)
        if progress.iteration == 9:
            self._ask_to_stop(signal.SIGINT, None)

    common = [*TINY, *options, "training.max_episodes=100", "ipt.every_episodes=30"]
    assert run("train", [*common, f"run_dir={tmp_path / 'whole'}"]) == 0
    with monkeypatch.context() as patch:
        patch.setattr(session.Session, "_report", interrupted)
        assert run("train", [*common, f"run_dir={tmp_path / 'parts'}"]) == 130
    assert run("train", [f"resume={tmp_path / 'parts'}"]) == 0
    whole, parts = (load_checkpoint(tmp_path / name / "checkpoint.pt") for name in ("whole", "parts"))
    assert same(whole, parts)
    assert metrics(tmp_path / "whole") == metrics(tmp_path / "parts")
    assert same(load_model(tmp_path / "whole"), load_model(tmp_path / "parts"))


def test_resume_keeps_what_it_is_told_and_spends_no_more(tmp_path, capsys):
    folder = tmp_path / "run"
    assert run("train", [*TINY, f"run_dir={folder}"]) == 0
    assert run("train", [f"resume={folder}", "training.max_episodes=190"]) == 0
    before = (folder / "metrics.csv").read_bytes()
    assert run("train", [f"resume={folder}"]) == 0
    assert "is used up" in capsys.readouterr().out
    assert (folder / "metrics.csv").read_bytes() == before
    done = json.loads((folder / "done.json").read_text())
    (folder / "done.json").unlink()  # as if killed after the last checkpoint
    assert run("train", [f"resume={folder}"]) == 0
    assert json.loads((folder / "done.json").read_text()) == done


def test_the_best_model_stays_the_best_over_extensions(tmp_path, monkeypatch):
    """Each part ends with a test of its own; what was kept after an earlier part is replaced by a better model only."""
    folder, costs = tmp_path / "run", iter([3.0, 5.0, 4.0, 2.0, 6.0])
    tests = []

    def tested(self):
        tests.append(TestResult(0.5, False, 2.0, next(costs), {}))
        return tests[-1]

    monkeypatch.setattr(Trainer, "run_test", tested)
    few = ["ipt.every_episodes=1000000", f"run_dir={folder}", "training.max_episodes=40"]
    assert run("train", [*TINY, *few]) == 0
    kept = [load_model(folder)[0]]
    for episodes in (60, 80, 100, 120):
        assert run("train", [f"resume={folder}", f"training.max_episodes={episodes}"]) == 0
        kept.append(load_model(folder)[0])
    assert len(tests) == 5
    assert [same(a, b) for a, b in pairwise(kept)] == [True, True, False, True]
    assert tested_of(folder / "model.safetensors") == (0.5, 2.0)
    assert json.loads((folder / "done.json").read_text())["best_cost"] == 2.0


def test_tensorboard_has_no_point_twice_or_after_the_checkpoint(tmp_path):
    folder = tmp_path / "run"
    assert run("train", [*TINY, "logger=tensorboard", "training.max_episodes=70", f"run_dir={folder}"]) == 0
    old = load_checkpoint(folder / "checkpoint.pt")["progress"]["env_steps"]
    with open(folder / "metrics.csv", "a", encoding="utf-8") as file:  # A row that was lost with a killed process.
        file.write(f"100000,{old + 99},99,99,1,0.1,0.1,0.1,,0.9,1\n")
    assert run("train", [f"resume={folder}", "training.max_episodes=150"]) == 0
    log = EventAccumulator(str(folder / "tensorboard"))
    log.Reload()
    steps = [event.step for event in log.Scalars("train/episodes")]
    assert steps == [int(row["env_steps"]) for row in metrics(folder)]
    assert steps == sorted(steps)
    assert old + 99 not in steps


def test_a_moved_run_logs_where_it_is(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run("train", [*TINY, "logger=tensorboard", "run_dir=here"]) == 0
    (tmp_path / "here").rename(tmp_path / "there")
    assert run("train", ["resume=there", "training.max_episodes=190"]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {"there"}


def start(folder, *more: str, stderr=subprocess.DEVNULL) -> subprocess.Popen[bytes]:
    """dore-train in a process of its own, once it has left a checkpoint."""
    code = "from dore.app.cli import train; train()"
    overrides = [*TINY, "training.max_episodes=1000000", "checkpoint_minutes=0.003", f"run_dir={folder}", *more]
    process = subprocess.Popen([sys.executable, "-c", code, *overrides], stderr=stderr)
    deadline = time.monotonic() + 90
    while not (folder / "checkpoint.pt").exists() and time.monotonic() < deadline:
        time.sleep(0.1)
    return process


def test_ctrl_c_leaves_a_checkpoint_and_says_how_to_go_on(tmp_path):
    process = start(tmp_path / "run")
    process.send_signal(signal.SIGINT)
    assert process.wait(60) == 130
    stopped_at = load_checkpoint(tmp_path / "run" / "checkpoint.pt")["progress"]["iteration"]
    assert int(metrics(tmp_path / "run")[-1]["iteration"]) == stopped_at
    assert not (tmp_path / "run" / "done.json").exists()


def test_a_second_ctrl_c_stops_at_once_without_a_traceback(tmp_path):
    log = tmp_path / "log"
    with open(log, "wb") as file:
        process = start(tmp_path / "run", stderr=file)
        os.kill(process.pid, signal.SIGSTOP)  # Both arrive while it is learning.
        for number in (signal.SIGINT, signal.SIGTERM):
            process.send_signal(number)
        os.kill(process.pid, signal.SIGCONT)
        assert process.wait(60) == 130
    said = log.read_text(encoding="utf-8")
    assert "Traceback" not in said
    assert load_checkpoint(tmp_path / "run" / "checkpoint.pt")


def test_kill_9_resumes_from_the_last_checkpoint(tmp_path):
    folder = tmp_path / "run"
    process = start(folder)
    os.kill(process.pid, signal.SIGKILL)
    process.wait(60)
    progress = load_checkpoint(folder / "checkpoint.pt")["progress"]
    more = f"training.max_episodes={progress['episodes'] + 60}"
    assert run("train", [f"resume={folder}", more]) == 0
    iterations = [int(row["iteration"]) for row in metrics(folder)]
    *rows, closing = iterations  # The budget's end is tested, and has a row of its own.
    assert rows == sorted(set(rows)), "no row is there twice"
    assert closing == rows[-1]
    assert iterations[-1] > progress["iteration"]
    assert not list(folder.glob(".*tmp*"))


def test_it_learns_and_stops_when_the_ipt_passes(tmp_path):
    overrides = [
        "layout.rows=3",
        "layout.cols=4",
        "instances.max_obstacles=4",
        "instances.validation_size=100",
        "env.num_envs=128",
        "network.widths=[64,64]",
        "exploration.anneal_steps=5000",
        "training.learning_starts=256",
        "training.max_episodes=60000",
        "ipt.n_batches=2",
        "ipt.batch_size=100",
        "ipt.every_episodes=250",
        "ipt.target_success=0.9",
        "optimizer.lr=0.002",
        "logger=none",
    ]
    assert run("train", [*overrides, f"run_dir={tmp_path / 'run'}"]) == 0
    done = json.loads((tmp_path / "run" / "done.json").read_text())
    assert done["stop_reason"] == "passed"
    assert done["success"] >= 0.9
    rows = [row for row in metrics(tmp_path / "run") if row["success"]]
    assert float(rows[0]["success"]) < 0.9, "the first test must not pass, or this shows nothing"


def test_a_run_leaves_its_files(tmp_path):
    assert run("train", [*TINY, "logger=tensorboard", f"run_dir={tmp_path / 'run'}"]) == 0
    names = {path.name for path in (tmp_path / "run").iterdir()}
    wanted = {"about.json", "checkpoint.pt", "config.yaml", "done.json", "learning_curve.png", "metrics.csv"}
    assert names == wanted | {"model.safetensors", "tensorboard"}
    assert list((tmp_path / "run" / "tensorboard").rglob("events*"))
    _, config = load_model(tmp_path / "run")
    assert config["layout"]["rows"] == 3


def test_divergence_stops_the_run(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(Learner, "update", lambda self, batch: torch.tensor(float("nan")))
    assert run("train", [*TINY, f"run_dir={tmp_path / 'run'}"]) == 1
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert "the loss is nan" in said
    assert "checkpoint" in said


def test_a_spoilt_weight_is_not_kept(tmp_path, capsys, monkeypatch):
    """An update may spoil the weights after its loss was fine."""
    update = Learner.update

    def spoilt(self, batch):
        loss = update(self, batch)
        if int(self.averaged.state_dict()["n_averaged"]) > 40:
            next(self.agent.networks.parameters()).data.fill_(float("inf"))
        return loss

    monkeypatch.setattr(Learner, "update", spoilt)
    monkeypatch.setattr(session.Trainer, "_diverged", lambda self, what: Diverged(what))
    assert run("train", [*TINY, "training.updates=1", "checkpoint_minutes=1e-9", f"run_dir={tmp_path / 'run'}"]) == 1
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert "a weight is no longer finite" in said
    kept = load_checkpoint(tmp_path / "run" / "checkpoint.pt")["learner"]["loss"]
    assert all(bool(value.isfinite().all()) for value in kept.values())


def test_a_batch_that_does_not_fit_names_its_key(tmp_path, capsys, monkeypatch):
    def full(self, batch):
        raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 20.00 MiB.")

    monkeypatch.setattr(Learner, "update", full)
    assert run("train", [*TINY, f"run_dir={tmp_path / 'run'}"]) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert said == "dore-train: training.batch_size: 8 x training.updates 2 takes more memory than there is, want less"


def test_epsilon_falls_linearly():
    epsilon = LinearEpsilon(start=1.0, end=0.1, anneal_steps=100)
    assert [round(epsilon(steps), 6) for steps in (0, 50, 100, 1000)] == [1.0, 0.55, 0.1, 0.1]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"max_episodes": 0}, "training.max_episodes: got 0"),
        ({"max_minutes": -1.0}, "training.max_minutes: got -1"),
        ({"batch_size": 2.5}, r"training.batch_size: got 2\.5"),
        ({"precision": "half"}, "training.precision: got 'half', want one of float32, bfloat16"),
    ],
)
def test_bad_budget(change, says):
    good = {
        "min_episodes": 0,
        "max_episodes": 1,
        "max_minutes": None,
        "batch_size": 1,
        "fill": 0,
        "update_after": "round",
        "updates": 1,
        "keep": "best",
        "learning_starts": 1,
    }
    with pytest.raises(InputError, match=says):
        Budget(**(good | {"max_grad_norm": None, "averaging": None, "precision": "float32"} | change))
