"""Checkpoints and model files: round trips, and one clear line for a file that is not right."""

from __future__ import annotations

import pytest
import torch

from dore import configure
from dore.errors import InputError
from dore.learn.checkpoint import load_checkpoint, load_model, save_checkpoint, save_model

CONFIG = {name: {} for name in ("layout", "reach", "instances", "agent", "network")}
PARTS = {"progress": {"iteration": 3, "loss": 0.5}, "weights": {"a": torch.arange(4.0)}, "rng": torch.get_rng_state()}


def test_checkpoint_round_trip(tmp_path):
    save_checkpoint(tmp_path / "c.pt", PARTS)
    again = load_checkpoint(tmp_path / "c.pt")
    assert again["progress"] == PARTS["progress"]
    assert torch.equal(again["weights"]["a"], torch.arange(4.0))
    assert [path.name for path in tmp_path.iterdir()] == ["c.pt"]


def test_model_round_trip(tmp_path):
    save_model(tmp_path / "model.safetensors", {"w": torch.ones(2, 3)}, CONFIG | {"layout": {"rows": 3}})
    for where in (tmp_path, tmp_path / "model.safetensors"):
        weights, config = load_model(where)
        assert torch.equal(weights["w"], torch.ones(2, 3))
        assert config == CONFIG | {"layout": {"rows": 3}}


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
@pytest.mark.parametrize("kind", ["checkpoint", "model"])
def test_cut_off_files(tmp_path, share, kind):
    path = tmp_path / "file"
    if kind == "checkpoint":
        save_checkpoint(path, PARTS)
    else:
        save_model(path, {"w": torch.ones(200)}, CONFIG)
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(InputError, match="cut off or damaged") as caught:
        load_checkpoint(path) if kind == "checkpoint" else load_model(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["checkpoint", "model"])
def test_a_changed_byte_is_noticed(tmp_path, kind):
    path = tmp_path / "file"
    if kind == "checkpoint":
        save_checkpoint(path, PARTS)
    else:
        save_model(path, {"w": torch.ones(200)}, CONFIG)
    data = bytearray(path.read_bytes())
    data[-300] ^= 1
    path.write_bytes(data)
    with pytest.raises(InputError, match="digest"):
        load_checkpoint(path) if kind == "checkpoint" else load_model(path)


def test_a_checkpoint_of_the_version_before_loads(tmp_path):
    torch.save({"format": "dore-checkpoint/1", "progress": 3}, tmp_path / "old.pt")
    assert load_checkpoint(tmp_path / "old.pt")["progress"] == 3


def test_weights_that_are_not_finite_are_refused(tmp_path):
    save_model(tmp_path / "model.safetensors", {"w": torch.tensor([1.0, float("nan")])}, CONFIG)
    with pytest.raises(InputError, match=r"model\.safetensors: w: holds numbers that are not finite"):
        load_model(tmp_path)


def test_an_unknown_group_in_a_models_config_is_refused(tmp_path):
    save_model(tmp_path / "model.safetensors", {"w": torch.ones(1)}, CONFIG | {"netwrok": {}})
    with pytest.raises(InputError, match=r"netwrok: no such key \(did you mean network\?\)"):
        load_model(tmp_path)


@pytest.mark.parametrize(
    "name",
    [
        *("os.makedirs", "torch.load", "builtins.eval", "subprocess.run", "torch.nn.init.zeros_", "", 3, None, ["x"]),
        *(
            "dore.learn.env.torch.load",
            "dore.files.atomic_write",
            "dore.learn.checkpoint.save_model",
            "dore.learn.none",
        ),
        *(
            "torch.nn.modules.linear.os.remove",
            "dore.app.metrics.MetricsLog",
            "torchrl.data.datasets.D4RLExperienceReplay",
        ),
    ],
)
def test_a_model_file_builds_no_other_classes(tmp_path, name):
    save_model(tmp_path / "model.safetensors", {"w": torch.ones(1)}, CONFIG | {"network": {"a": [{"_target_": name}]}})
    with pytest.raises(InputError, match=r"the file names .*, want a class of dore or torch"):
        load_model(tmp_path)


@pytest.mark.parametrize("name", ["torch.nn.Linear", "dore.learn.networks.MLP", "dore.world.layout.Layout.grid"])
def test_a_model_file_builds_these(tmp_path, name):
    save_model(tmp_path / "model.safetensors", {"w": torch.ones(1)}, CONFIG | {"network": {"_target_": name}})
    load_model(tmp_path)


def test_a_user_extends_the_list(tmp_path, monkeypatch):
    monkeypatch.setattr(configure, "_users", set())
    save_model(
        tmp_path / "model.safetensors", {"w": torch.ones(1)}, CONFIG | {"network": {"_target_": "mine.nets.Net"}}
    )
    with pytest.raises(InputError, match=r"trust=\[its module\]"):
        load_model(tmp_path)
    configure.trust("mine")
    load_model(tmp_path)
    with pytest.raises(InputError, match="trust: got 'a b'"):
        configure.trust("a b")


def test_files_of_another_kind(tmp_path):
    torch.save({"a": 1}, tmp_path / "other.pt")
    with pytest.raises(InputError, match="no checkpoint of this program"):
        load_checkpoint(tmp_path / "other.pt")
    with pytest.raises(InputError, match="no such file"):
        load_model(tmp_path)
    with pytest.raises(InputError, match="no such file"):
        load_checkpoint(tmp_path / "none.pt")


def test_a_failed_write_leaves_the_old_file(tmp_path):
    save_checkpoint(tmp_path / "c.pt", PARTS)
    before = (tmp_path / "c.pt").read_bytes()
    with pytest.raises(AttributeError):
        save_checkpoint(tmp_path / "c.pt", {"bad": lambda: None})
    assert (tmp_path / "c.pt").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["c.pt"]
