"""The running mean of the weights: what it is, that it only acts where it is asked to, and that it is saved."""

from __future__ import annotations

import pytest
import torch

from dore.errors import InputError
from dore.learn.averaging import AveragedWeights
from dore.learn.checkpoint import load_checkpoint, load_model
from tests.commands import TINY, run


def line(value: float) -> torch.nn.Linear:
    made = torch.nn.Linear(1, 1, bias=False)
    made.weight.data.fill_(value)
    return made


def test_the_mean_follows_the_weights():
    network = line(0.0)
    averaged = AveragedWeights(network, 0.5)
    expected = 0.0
    for n, value in enumerate((4.0, 8.0, 2.0)):
        network.weight.data.fill_(value)
        averaged.step()
        decay = min(0.5, (1 + n) / (10 + n))
        # The first step takes the weights as they are.
        expected = value if n == 0 else decay * expected + (1 - decay) * value
        assert averaged.weights()["weight"].item() == pytest.approx(expected)


def test_it_acts_only_where_it_is_asked_to():
    network = line(1.0)
    averaged = AveragedWeights(network, 0.9)
    averaged.step()
    network.weight.data.fill_(3.0)
    with averaged.acting():
        assert network.weight.item() == 1.0
    assert network.weight.item() == 3.0


def test_without_a_mean_the_weights_are_what_they_are():
    network = line(1.0)
    averaged = AveragedWeights(network, None)
    averaged.step()
    network.weight.data.fill_(3.0)
    with averaged.acting():
        assert network.weight.item() == 3.0
    assert averaged.weights()["weight"].item() == 3.0


@pytest.mark.parametrize("decay", [0.0, 1.0, -1.0, "much"])
def test_a_decay_outside_its_domain(decay):
    with pytest.raises(InputError, match=r"training.averaging: got"):
        AveragedWeights(line(0.0), decay)


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_a_run_keeps_the_mean_in_float32(tmp_path, precision):
    options = [f"training.precision={precision}", "training.max_episodes=60", "training.updates=1"]
    for name in "ab":
        assert run("train", [*TINY, *options, "training.averaging=0.9", f"run_dir={tmp_path / name}"]) == 0
    weights = [load_model(tmp_path / name)[0] for name in "ab"]
    assert all(torch.equal(weights[0][name], weights[1][name]) for name in weights[0]), "same seed, same run"
    assert all(value.dtype is torch.float32 for value in weights[0].values())
    parts = load_checkpoint(tmp_path / "a" / "checkpoint.pt")
    assert int(parts["learner"]["averaged"]["n_averaged"]) > 1


def test_the_model_is_the_mean_and_not_the_last_weights(tmp_path):
    # The only test is that at the end, so that the model kept is that of the checkpoint.
    options = ["training.max_episodes=100", "ipt.every_episodes=1000", "training.averaging=0.9"]
    assert run("train", [*TINY, *options, f"run_dir={tmp_path / 'run'}"]) == 0
    weights, _ = load_model(tmp_path / "run")
    parts = load_checkpoint(tmp_path / "run" / "checkpoint.pt")
    for name, value in weights.items():
        assert torch.equal(parts["learner"]["averaged"][f"module.{name}"], value), name
    head, _, rest = next(iter(weights)).partition(".")
    last = parts["learner"]["loss"][f"{head}_params.module.{rest}"]
    assert not torch.equal(last, weights[f"{head}.{rest}"])
