"""Training that starts from a model's weights."""

import torch

from dore.learn.checkpoint import load_model
from tests.commands import TINY, run
from tests.learn.runs import literal


def test_a_run_starts_from_a_models_weights_online_and_target_alike(tmp_path):
    assert run("train", [*TINY, "layout.cols=4", "network.widths=[8]", f"run_dir={tmp_path / 'first'}"]) == 0
    options = ["network.widths=[8]", "agent.encoding=planes"]
    fresh, begun = literal("sequential", *options), literal("sequential", *options, f"init={tmp_path / 'first'}")
    weights, _ = load_model(tmp_path / "first")
    for name, value in begun.learner.agent.networks.state_dict().items():
        assert torch.equal(value, weights[name])
        assert not torch.equal(value, fresh.learner.agent.networks.state_dict()[name])
    state = begun.learner.agent.loss.state_dict()
    targets = {name: value for name, value in state.items() if name.startswith("target_")}
    assert targets
    assert all(torch.equal(value, state[name.removeprefix("target_")]) for name, value in targets.items())


def test_a_model_of_other_networks_is_refused(tmp_path, capsys):
    assert run("train", [*TINY, f"run_dir={tmp_path / 'first'}"]) == 0
    again = [*TINY, "network.widths=[8]", f"init={tmp_path / 'first'}", f"run_dir={tmp_path / 'second'}"]
    assert run("train", again) == 2
    assert "is not for the networks of this config" in capsys.readouterr().err
    assert run("train", [*TINY, "init=nowhere", f"run_dir={tmp_path / 'second'}"]) == 2
    assert "nowhere" in capsys.readouterr().err
    assert not (tmp_path / "second").exists()
