"""Checkpoints and model files: round trips, and one clear line for a file that is not right."""

from __future__ import annotations

import pytest
import torch

from dore.errors import InputError
from dore.learn.checkpoint import load_checkpoint, load_model, save_checkpoint, save_model

PARTS = {"progress": {"iteration": 3, "loss": 0.5}, "weights": {"a": torch.arange(4.0)}, "rng": torch.get_rng_state()}


def test_checkpoint_round_trip(tmp_path):
    save_checkpoint(tmp_path / "c.pt", PARTS)
    again = load_checkpoint(tmp_path / "c.pt")
    assert again["progress"] == PARTS["progress"]
    assert torch.equal(again["weights"]["a"], torch.arange(4.0))
    assert [path.name for path in tmp_path.iterdir()] == ["c.pt"]


def test_model_round_trip(tmp_path):
    save_model(tmp_path / "model.safetensors", {"w": torch.ones(2, 3)}, {"layout": {"rows": 3}})
    for where in (tmp_path, tmp_path / "model.safetensors"):
        weights, config = load_model(where)
        assert torch.equal(weights["w"], torch.ones(2, 3))
        assert config == {"layout": {"rows": 3}}


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
@pytest.mark.parametrize("kind", ["checkpoint", "model"])
def test_cut_off_files(tmp_path, share, kind):
    path = tmp_path / "file"
    if kind == "checkpoint":
        save_checkpoint(path, PARTS)
    else:
        save_model(path, {"w": torch.ones(200)}, {})
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(InputError, match="cut off or damaged") as caught:
        load_checkpoint(path) if kind == "checkpoint" else load_model(path)
    assert "\n" not in str(caught.value)


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
