"""The whole loop on a CUDA device: `make test` leaves these out, `pytest -m gpu` runs them where there is one."""

from __future__ import annotations

import json

import pytest
import torch
from torchrl.envs import check_env_specs

from dore.world.generator import Difficulty
from dore.world.instances import InstanceSet
from tests.commands import TINY, run
from tests.drawings import wide_hand
from tests.worlds import make_env

pytestmark = [
    pytest.mark.gpu,
    pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device"),
]


def test_specs():
    check_env_specs(make_env(wide_hand(3, 6).to("cuda"), 16, 6))


def test_accessible_is_the_same_as_on_the_cpu():
    reach = wide_hand(10, 10, 0.09)
    occupied = torch.rand(500, 100, generator=torch.Generator().manual_seed(0)) < 0.2
    assert torch.equal(reach.to("cuda").accessible(occupied.cuda()).cpu(), reach.accessible(occupied))


def test_instances_are_drawn_on_the_device():
    reach = wide_hand(6, 6).to("cuda")
    assert InstanceSet.generate(reach, 100, Difficulty(3, 8), "test", 0).board.is_cuda


@pytest.mark.parametrize("agent", ["sequential", "single"])
def test_training_stops_and_resumes(tmp_path, agent):
    folder = tmp_path / "run"
    assert run("train", [*TINY, f"agent={agent}", "device=cuda", f"run_dir={folder}"]) == 0
    before = json.loads((folder / "done.json").read_text())["episodes"]
    assert run("train", [f"resume={folder}", f"training.max_episodes={before + 100}"]) in (0, 130)
    assert run("evaluate", [f"model={folder}", "device=cuda", "limit=5", f"run_dir={tmp_path / 'e'}"]) == 0
