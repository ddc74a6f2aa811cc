"""Algorithm 2: it learns, the same seed gives the same run, and what goes wrong is said in one line."""

from __future__ import annotations

import json
from types import SimpleNamespace

import hydra
import pytest
import torch
from hydra.core.global_hydra import GlobalHydra

from dore.app import session, train
from dore.app.training import trainer_of
from dore.errors import InputError
from dore.files import conf_dir
from dore.learn.budget import Budget, LinearEpsilon
from dore.learn.checkpoint import load_checkpoint, load_model
from dore.learn.learner import Learner
from dore.learn.trainer import Diverged
from tests.commands import TINY, run
from tests.learn.runs import metrics, same


@pytest.mark.parametrize("agent", ["sequential", "single"])
def test_same_seed_same_run_and_another_seed_another(tmp_path, agent):
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        assert run("train", [*TINY, f"agent={agent}", f"seed={seed}", f"run_dir={tmp_path / name}"]) == 0
    checkpoints = [load_checkpoint(tmp_path / name / "checkpoint.pt") for name in "abc"]
    assert same(checkpoints[0], checkpoints[1])
    assert not same(checkpoints[0]["learner"]["loss"], checkpoints[2]["learner"]["loss"])
    assert metrics(tmp_path / "a") == metrics(tmp_path / "b")


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


@pytest.mark.parametrize(
    ("budget", "way"),
    [
        ("training.max_episodes=100000", (2122, 5000, "ep")),  # to the next test
        ("training.max_episodes=3000", (2122, 3000, "ep")),
        ("training.min_episodes=22000", (2122, 25000, "ep")),  # to the first test that can end it
        ("training.max_minutes=4", (1.5, 4.0, "min")),
        ("training.max_updates=400", (300, 400, "updates")),
        ("training.max_minutes=4000", (2122, 5000, "ep")),  # its episodes are spent long before
    ],
)
def test_the_bar_runs_to_what_ends_the_run(budget, way):
    GlobalHydra.instance().clear()
    options = [*TINY, "training.max_episodes=100000", "ipt.every_episodes=5000", budget]
    with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
        trainer = trainer_of(hydra.compose("train", options))
    progress = trainer.progress
    progress.episodes, progress.seconds, progress.updates = 2122, 90.0, 300
    assert trainer.way_to_end() == way


def test_a_run_leaves_its_files(tmp_path):
    assert run("train", [*TINY, "logger=tensorboard", f"run_dir={tmp_path / 'run'}"]) == 0
    names = {path.name for path in (tmp_path / "run").iterdir()}
    wanted = {"about.json", "checkpoint.pt", "config.yaml", "done.json", "learning_curve.png", "metrics.csv"}
    assert names == wanted | {"model.safetensors", "tensorboard"}
    assert list((tmp_path / "run" / "tensorboard").rglob("events*"))
    _, config = load_model(tmp_path / "run")
    assert config["layout"]["rows"] == 3


def test_a_run_ends_with_its_updates_and_goes_on_with_more(tmp_path, capsys):
    options = [*TINY, "training.max_episodes=100000", f"run_dir={tmp_path / 'run'}", "existing=continue"]
    for limit in (10, 30):
        assert run("train", [*options, f"training.max_updates={limit}"]) == 0
        done = json.loads((tmp_path / "run" / "done.json").read_text())
        assert done["stop_reason"] == "budget"
        assert limit <= done["updates"] < limit + 10
    capsys.readouterr()
    assert run("train", [*options, "training.max_updates=30"]) == 0
    assert "finished" in capsys.readouterr().out
    assert run("train", [f"resume={tmp_path / 'run'}"]) == 0
    assert "training.max_updates=60" in capsys.readouterr().out


@pytest.mark.parametrize(("limit", "hint"), [("max_episodes", "=2469134"), ("max_minutes", "=3")])
def test_the_hint_doubles_what_is_spent(tmp_path, limit, hint):
    spent = SimpleNamespace(nearest_limit=limit, budget=SimpleNamespace(max_episodes=1_234_567, max_minutes=1.5))
    assert train._resume_with(tmp_path, spent).endswith(f"training.{limit}{hint}")


def test_divergence_stops_the_run(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(Learner, "update", lambda self, batch, lessons: torch.tensor(float("nan")))
    assert run("train", [*TINY, f"run_dir={tmp_path / 'run'}"]) == 1
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert "the loss is nan" in said
    assert "checkpoint" in said


def test_a_spoilt_weight_is_not_kept(tmp_path, capsys, monkeypatch):
    """An update may spoil the weights after its loss was fine."""
    update = Learner.update

    def spoilt(self, batch, agent):
        loss = update(self, batch, agent)
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
    def full(self, batch, agent):
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
        ({"max_updates": 0}, "training.max_updates: got 0"),
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
