"""dore-execute from the command line: bad input, an open loop, and a closed one with its camera."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.commands import run
from tests.rendering import needs_vulkan

pytestmark = pytest.mark.sim


@pytest.mark.parametrize(
    ("overrides", "says"),
    [
        ([], "plan, scene: want one of them"),
        (["plan=conf/plans/fig7.json", "scene=random"], "plan, scene: want one of them"),
        (["plan=conf/plans/fig7.json", "loop=closed"], "want scene= and not plan="),
        (["scene=random", "loop=half"], "loop: got 'half', want open or closed"),
        (["scene=random", "obstacles=18"], "obstacles: got 18, want at most 17"),
        (["scene=random", "obstacles=0"], "obstacles: got 0"),
        (["scene=random", "jitter_m=-1"], "jitter_m: got -1"),
        (["scene=random", "disturbance=flood"], "flood"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(tmp_path, capfd, overrides, says):
    assert run("execute", [*overrides, f"run_dir={tmp_path / 'run'}"]) == 2
    error = capfd.readouterr().err.strip()
    assert says in error
    assert "\n" not in error
    assert not (tmp_path / "run").exists()


def test_a_scene_is_planned_and_carried_out(tmp_path, capfd):
    assert run("execute", ["scene=random", "obstacles=5", "video=off", "seed=4", f"run_dir={tmp_path / 'run'}"]) == 0
    assert "done: " in capfd.readouterr().out
    assert json.loads((tmp_path / "run" / "execution.json").read_text())["planner"] == "exact"


@needs_vulkan
def test_a_real_camera_closes_the_loop(tmp_path, capfd):
    overrides = ["scene=random", "obstacles=5", "loop=closed", "disturbance=moved", "video=off", "seed=2"]
    assert run("execute", [*overrides, f"run_dir={tmp_path / 'run'}"]) == 0
    report = json.loads((tmp_path / "run" / "execution.json").read_text())
    assert report["claimed"]
    assert report["conditions"]["success"]
    assert np.isfinite(report["simulated_s"])
