"""A run's folder: resumed, in use, and what says that it is done."""

from __future__ import annotations

import json

import pytest

from dore.app import run_folder
from dore.errors import InputError
from dore.files import locked
from dore.learn.trainer import StopReason
from tests.commands import TINY, run


def test_a_folder_that_is_there_is_resumed(tmp_path, capsys):
    folder = tmp_path / "run"
    arguments = [*TINY, f"run_dir={folder}", "existing=continue"]
    assert run("train", arguments) == 0
    assert run("train", arguments) == 0
    assert "finished already" in capsys.readouterr().out
    done = json.loads((folder / "done.json").read_text())
    done["ending"] = done.pop("stop_reason")  # as version 0.1 wrote it
    (folder / "done.json").write_text(json.dumps(done))
    assert run("train", arguments) == 0
    assert "finished already" in capsys.readouterr().out
    assert run("train", [*arguments, "training.max_episodes=190", "agent.gamma=0.9"]) == 2
    assert "was started with agent.gamma=0.8, not 0.9" in capsys.readouterr().err
    (folder / "checkpoint.pt").unlink()
    (folder / "done.json").unlink()
    (folder / "config.yaml").unlink()
    assert run("train", arguments) == 2, "nothing of a run that it could have been"
    assert (folder / "metrics.csv").exists()


def test_a_checkpoint_goes_with_no_other_config(tmp_path, capsys):
    """Neither with an edited one, nor with that of another run."""
    folder, other = tmp_path / "run", tmp_path / "other"
    assert run("train", [*TINY, f"run_dir={folder}"]) == 0
    assert run("train", [*TINY, f"run_dir={other}", "seed=7"]) == 0
    more = [f"resume={folder}", "training.max_episodes=190"]
    config, checkpoint = (folder / name for name in ("config.yaml", "checkpoint.pt"))
    own, kept = config.read_text(encoding="utf-8"), checkpoint.read_bytes()
    config.write_text(own.replace("gamma: 0.8", "gamma: 0.7"), encoding="utf-8")
    assert run("train", more) == 2
    assert f"{checkpoint} was started with agent.gamma=0.8, not 0.7" in capsys.readouterr().err
    config.write_text(own, encoding="utf-8")
    checkpoint.write_bytes((other / "checkpoint.pt").read_bytes())
    assert run("train", more) == 2
    assert f"{checkpoint} was started with seed=7, not" in capsys.readouterr().err
    checkpoint.write_bytes(kept)
    model = folder / "model.safetensors"
    mine = model.read_bytes()
    model.write_bytes((other / "model.safetensors").read_bytes())
    assert run("train", more) == 2
    assert f"{model} was started with seed=7, not" in capsys.readouterr().err
    assert (folder / "done.json").exists()
    model.write_bytes(mine)
    assert run("train", more) == 0


def test_a_folder_in_use_is_left_alone(tmp_path, capsys):
    folder = tmp_path / "run"
    assert run("train", [*TINY, f"run_dir={folder}"]) == 0
    with locked(folder, "run_dir"):
        assert run("train", [f"resume={folder}", "training.max_episodes=190"]) == 2
        (folder / "checkpoint.pt").unlink()
        with pytest.raises(InputError, match="is in use by another process"):
            run_folder.clear_unstarted(folder)
    assert (folder / "metrics.csv").exists()


def test_the_budgets_stop_reason_is_known_without_torch():
    assert run_folder.BUDGET == StopReason.BUDGET


def test_an_unknown_key_in_a_runs_config_is_refused(tmp_path, capsys):
    folder = tmp_path / "run"
    assert run("train", [*TINY, f"run_dir={folder}"]) == 0
    text = (folder / "config.yaml").read_text()
    for damaged, says in (
        (text + "treining: 3\n", "treining: no such key (did you mean training?)"),
        (text + "seed: 4\n", "found duplicate key seed"),
        (text.replace("  max_episodes:", "  max_episods:"), "training: "),
        (text.replace("name: train", "name: ${oc.env:HOME}"), "name: got '${oc.env:HOME}', want a value"),
        (text.replace("dore.learn.budget.Budget", "os.makedirs"), "the file names 'os.makedirs'"),
    ):
        (folder / "config.yaml").write_text(damaged)
        assert run("train", [f"resume={folder}", "training.max_episodes=190"]) == 2
        said = capsys.readouterr().err
        assert says in said
        assert said.count("\n") == 1


def test_a_folder_with_files_of_the_users_own_is_left_alone(tmp_path):
    (tmp_path / "run").mkdir()
    for name in ("config.yaml", "notes.txt"):
        (tmp_path / "run" / name).write_text("mine")
    assert run("train", [*TINY, f"run_dir={tmp_path / 'run'}", "existing=continue"]) == 2
    assert sorted(path.name for path in (tmp_path / "run").iterdir()) == ["config.yaml", "notes.txt"]
