"""Algorithm 2 as printed: the fill counts for nothing, an update follows each episode, the last model is returned."""

from __future__ import annotations

import json

import pytest
import torch

from dore.app import session
from dore.errors import InputError
from dore.learn.checkpoint import BEST_NAME, load_checkpoint, load_model
from dore.learn.trainer import MAIN
from tests.commands import run
from tests.learn.runs import LITERAL, ctrl_c_at, key_of, literal, metrics, same


@pytest.mark.parametrize("unit", ["episode", "step"])
def test_the_fill_counts_for_nothing_and_each_unit_has_its_update(unit):
    trainer = literal("sequential", f"training.update_after={unit}", "env.num_envs=5")
    resets: list[int] = []
    reset = trainer.worlds[MAIN].player.reset
    trainer.worlds[MAIN].player.reset = lambda: (resets.append(trainer.progress.filled), reset())[1]
    while trainer.progress.filled < 50:
        trainer.iterate()
        assert trainer.learner.agent.choosers[0].explore.eps.item() == 1.0
    progress = trainer.progress
    assert (progress.filled, progress.env_steps, progress.episodes, progress.updates) == (50, 0, 0, 0)
    assert len(trainer.worlds[MAIN].buffer) == 50
    trainer.iterate()
    assert resets == [0, 50], "the first episode that counts is a new one"
    assert set(trainer.worlds[MAIN].player._length.tolist()) <= {0, 1}
    assert progress.epsilon == trainer.epsilon.start, "epsilon falls over what is played after the fill"
    while not trainer.spent():
        trainer.iterate()
    assert progress.episodes == 60, "not one more than T_lim"
    stored = len(trainer.worlds[MAIN].buffer) - 50
    assert progress.updates == (60 if unit == "episode" else stored)
    assert stored > 60


def test_an_ipt_follows_every_n_episodes_exactly(monkeypatch):
    """With twenty environments many episodes end at once; the weights tested are those after the n-th."""
    trainer = literal("sequential", "env.num_envs=20", "ipt.every_episodes=7")
    tested: list[tuple[int, int]] = []
    run_test = trainer.run_test
    monkeypatch.setattr(
        trainer,
        "run_test",
        lambda: (tested.append((trainer.progress.episodes, trainer.progress.updates)), run_test())[1],
    )
    trainer.run(lambda progress, result: None, stop=lambda: False)
    assert tested == [(n, n) for n in range(7, 60, 7)]


def test_the_last_model_is_returned_and_the_best_lies_beside_it(tmp_path):
    folder = tmp_path / "run"
    assert run("train", ["experiment=paper/sequential", *LITERAL, "ipt.every_episodes=5", f"run_dir={folder}"]) == 0
    last, _ = load_model(folder)
    networks = load_checkpoint(folder / "checkpoint.pt")["learner"]["loss"]
    assert all(torch.equal(value, networks[key_of(name)]) for name, value in last.items())
    best, _ = load_model(folder / BEST_NAME)
    assert best.keys() == last.keys()
    assert any(not torch.equal(value, last[name]) for name, value in best.items())
    done = json.loads((folder / "done.json").read_text())
    assert (done["episodes"], done["updates"], done["filled"]) == (60, 60, 50)
    assert done["best_success"] == max(float(row["success"]) for row in metrics(folder) if row["success"])


@pytest.mark.parametrize("stop_at", [2, 7, 10, 12])
def test_stopped_while_it_fills_or_learns_it_resumes_as_if_it_had_not(tmp_path, stop_at):
    common = ["experiment=paper/sequential", *LITERAL, "env.num_envs=20", "ipt.every_episodes=7"]
    assert run("train", [*common, f"run_dir={tmp_path / 'whole'}"]) == 0
    with ctrl_c_at(stop_at):
        assert run("train", [*common, f"run_dir={tmp_path / 'parts'}"]) == 130
    stopped = load_checkpoint(tmp_path / "parts" / "checkpoint.pt")
    assert (stopped["progress"]["updates"] == 0) == (stop_at == 2)
    assert run("train", [f"resume={tmp_path / 'parts'}"]) == 0
    whole, parts = (load_checkpoint(tmp_path / name / "checkpoint.pt") for name in ("whole", "parts"))
    assert same(whole, parts)
    assert metrics(tmp_path / "whole") == metrics(tmp_path / "parts")


def test_a_run_that_ends_while_it_fills_says_so(tmp_path, capsys):
    folder = tmp_path / "run"
    more = ["training.fill=300", "training.max_minutes=1e-6", f"run_dir={folder}"]
    assert run("train", ["experiment=paper/sequential", *LITERAL, *more]) == 0
    said = capsys.readouterr().out
    assert "nothing was learned: the replay holds" in said
    assert "of training.fill 300 transitions" in said
    assert "learning_curve" not in said
    done = json.loads((folder / "done.json").read_text(), parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    assert done["loss"] is None


def test_only_the_budget_changes_when_a_run_is_resumed(tmp_path, capsys):
    folder = tmp_path / "run"
    assert run("train", ["experiment=paper/sequential", *LITERAL, "training.max_episodes=20", f"run_dir={folder}"]) == 0
    assert run("train", [f"resume={folder}", "training.fill=90"]) == 2
    assert "training.fill=90 cannot be changed" in capsys.readouterr().err


def test_a_killed_run_leaves_the_last_model_of_its_checkpoint(tmp_path, monkeypatch):
    """keep=last writes the model with each checkpoint."""
    monkeypatch.setattr(session.Session, "_conclude", lambda self, ending: None)
    assert run("train", ["experiment=paper/sequential", *LITERAL, f"run_dir={tmp_path / 'run'}"]) == 0
    last, _ = load_model(tmp_path / "run")
    networks = load_checkpoint(tmp_path / "run" / "checkpoint.pt")["learner"]["loss"]
    assert all(torch.equal(value, networks[key_of(name)]) for name, value in last.items())


def test_updates_begin_when_the_buffer_holds_enough():
    trainer = literal("sequential", "training.fill=0", "training.learning_starts=20", "training.update_after=step")
    first = None
    while not trainer.spent() and first is None:
        held = len(trainer.worlds[MAIN].buffer)
        trainer.iterate()
        if trainer.progress.updates:
            first = held + trainer.worlds[MAIN].env.batch_size[0] - trainer.progress.updates + 1
    assert first == 20


def test_no_test_before_the_first_update_and_none_ends_a_run_before_its_least_episodes():
    late = literal("sequential", "training.fill=0", "training.learning_starts=400", "ipt.every_episodes=5")
    tested: list[int] = []
    late.run(lambda progress, result: tested.extend([progress.episodes] * (result is not None)), stop=lambda: False)
    assert tested == []
    easy = literal("sequential", "training.min_episodes=15", "ipt.every_episodes=5", "ipt.target_success=1e-9")
    assert easy.run(lambda progress, result: None, stop=lambda: False) == "passed"
    assert easy.progress.episodes == 15


@pytest.mark.parametrize("interval", ["-1", "9.5", "abc"])
def test_a_copy_interval_that_is_no_count_is_one_line(interval):
    with pytest.raises(InputError, match=f"value_network_update_interval: got '?{interval}"):
        literal("sequential", f"target_update.value_network_update_interval={interval}")


def test_a_run_folder_of_version_0_1_says_what_to_do(tmp_path, capsys):
    folder = tmp_path / "run"
    assert run("train", ["experiment=paper/sequential", *LITERAL, "training.max_episodes=20", f"run_dir={folder}"]) == 0
    config = (folder / "config.yaml").read_text().replace("updates: 1", "updates_per_step: 1")
    (folder / "config.yaml").write_text(config)
    assert run("train", [f"resume={folder}"]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "version 0.1" in line
    assert "training.updates" in line
