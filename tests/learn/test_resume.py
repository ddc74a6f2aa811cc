"""A stopped, killed or extended run is the uninterrupted one."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from itertools import pairwise

import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from dore.app.run_folder import CHECKPOINT
from dore.learn import replay
from dore.learn.checkpoint import ipt_of, load_checkpoint, load_model, save_checkpoint
from dore.learn.evaluator import TestResult
from dore.learn.trainer import Trainer
from tests.commands import TINY, run
from tests.learn.runs import metrics, same, stopped_and_resumed


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
def test_interrupt_and_resume_equals_uninterrupted(tmp_path, options):
    common = [*TINY, *options, "training.max_episodes=100", "ipt.every_episodes=30"]
    whole, parts = stopped_and_resumed(tmp_path, common, iteration=9)
    assert same(whole, parts)
    assert metrics(tmp_path / "whole") == metrics(tmp_path / "parts")
    assert same(load_model(tmp_path / "whole"), load_model(tmp_path / "parts"))


def test_a_checkpoint_holds_the_transitions_there_are_and_older_ones_load(tmp_path):
    folder, old = tmp_path / "run", tmp_path / "old"
    assert run("train", [*TINY, "buffer.storage.max_size=100000", "training.max_episodes=70", f"run_dir={folder}"]) == 0
    shutil.copytree(folder, old)
    state = load_checkpoint(folder / CHECKPOINT)
    weights = sum(one.nbytes for one in leaves_of(state["learner"]))
    assert (folder / CHECKPOINT).stat().st_size - weights < 200_000  # With its empty places the replay takes 2.4 MB.
    buffer = state["worlds"]["main"]["buffer"]
    buffer["rows"] = replay._unpacked(buffer["rows"])
    save_checkpoint(old / CHECKPOINT, state)
    for one in (folder, old):
        assert run("train", [f"resume={one}", "training.max_episodes=100"]) == 0
    assert same(load_checkpoint(folder / CHECKPOINT), load_checkpoint(old / CHECKPOINT))


def leaves_of(state: object) -> list[torch.Tensor]:
    """The tensors in a state."""
    if isinstance(state, torch.Tensor):
        return [state]
    parts = state.values() if isinstance(state, dict) else state if isinstance(state, list | tuple) else ()
    return [leaf for part in parts for leaf in leaves_of(part)]


def test_resume_keeps_its_settings_and_spends_no_more(tmp_path, capsys):
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
    assert ipt_of(folder / "model.safetensors") == (0.5, 2.0)
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


@pytest.mark.slow
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


def test_ctrl_c_leaves_a_checkpoint_and_says_how_to_resume(tmp_path):
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
