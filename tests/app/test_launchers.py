"""Sweeps by Hydra's plugins: a launcher or sweeper that is not there names its extra, and each that is there runs."""

from __future__ import annotations

import importlib.util
import json

import pytest
from joblib.externals.loky.process_executor import TerminatedWorkerError

from dore.app import cli
from tests.commands import TINY, complaints, run


def needs(plugin: str) -> pytest.MarkDecorator:
    return pytest.mark.skipif(
        importlib.util.find_spec(f"hydra_plugins.{plugin}") is None, reason=f"{plugin} is not there"
    )


@pytest.mark.parametrize(
    ("option", "extra"),
    [("hydra/launcher=ray", "ray"), ("hydra/launcher=submitit_slurm", "slurm"), ("hydra/sweeper=tune", "optuna")],
)
def test_a_plugin_that_is_not_there_names_its_extra(tmp_path, capsys, option, extra):
    plugin = {"ray": "hydra_ray_launcher", "slurm": "hydra_submitit_launcher", "optuna": "hydra_optuna_sweeper"}[extra]
    if importlib.util.find_spec(f"hydra_plugins.{plugin}"):
        pytest.skip(f"{plugin} is there")
    assert run("train", ["-m", *TINY, option, f"hydra.sweep.dir={tmp_path}"]) == 2
    (line,) = complaints(capsys)
    assert f"not installed, want the extra `{extra}`" in line


@pytest.mark.parametrize(
    "launcher",
    [
        pytest.param(["hydra/launcher=submitit_local"], marks=needs("hydra_submitit_launcher")),
        pytest.param(["hydra/launcher=ray", "+hydra.launcher.ray.init.num_cpus=2"], marks=needs("hydra_ray_launcher")),
    ],
)
def test_other_launchers(tmp_path, capsys, monkeypatch, launcher):
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    arguments = ["-m", *TINY, "agent=single,sequential", *launcher, f"hydra.sweep.dir={tmp_path}"]
    assert run("train", arguments) == 0
    assert "2 jobs done (0 of them before), 0 broken" in capsys.readouterr().out
    assert run("train", arguments) == 0
    assert "2 jobs done (2 of them before), 0 broken" in capsys.readouterr().out


@needs("hydra_optuna_sweeper")
def test_optuna_maximises_and_starts_again(tmp_path, capsys):
    trials = ["hydra/sweeper=tune", "hydra.sweeper.n_trials=3", "optimizer.lr=tag(log, interval(0.001, 0.01))"]
    arguments = ["-m", *TINY, *trials, f"hydra.sweep.dir={tmp_path}"]
    assert run("train", arguments) == 0
    best = (tmp_path / "optimization_results.yaml").read_text()
    scores = [json.loads(path.read_text())["best_success"] for path in tmp_path.glob("*/done.json")]
    assert len(scores) == 3
    assert f"best_value: {max(scores)}" in best
    assert run("train", arguments) == 0
    assert "3 jobs done (3 of them before), 0 broken" in capsys.readouterr().out
    assert (tmp_path / "optimization_results.yaml").read_text() == best
    nothing = ["hydra/sweeper=tune", "hydra.sweeper.n_trials=2", "training.batch_size=0", "optimizer.lr=choice(1,2)"]
    assert run("train", ["-m", *TINY, *nothing, f"hydra.sweep.dir={tmp_path / 'nothing'}"]) == 2
    *broken, last = complaints(capsys)
    assert sum("training.batch_size: got 0" in line for line in broken) == 2
    assert last.startswith("dore-train: ValueError: No trials are completed")


def test_workers_that_a_signal_ends_are_no_segmentation_fault():
    error = TerminatedWorkerError("... could be caused by a segmentation fault ...")
    assert cli._why_the_launcher_ended(error).startswith("a process of the launcher was ended from outside")
    assert cli._why_the_launcher_ended(ValueError("no\n trials")) == "ValueError: no trials"
