"""An old key or option is refused in one line that names the new one, and the new one exists."""

from __future__ import annotations

import re

import pytest
from omegaconf import OmegaConf

from dore.app.renamed import KEYS, OPTIONS, hint
from dore.files import conf_dir
from tests.app.test_conf import compose
from tests.commands import run


@pytest.mark.parametrize(
    ("override", "says"),
    [
        ("eye=kinect", "eye: renamed, want camera"),
        ("eye.noise=none", "eye.noise: renamed, want camera.noise"),
        ("eye.eye_m=[1,0,1]", "eye.eye_m: renamed, want camera.position_m"),
        ("camera=corner_large", "camera=corner_large: renamed, want view=corner_large"),
        ("camera.shadows=true", "camera.shadows: renamed, want view.shadows"),
        ("arm.lane_margin_m=0.02", "arm.lane_margin_m: renamed, want arm.corridor_margin_m"),
        ("disturbance=stranger", "disturbance=stranger: renamed, want disturbance=intruder"),
    ],
)
def test_an_old_name_is_refused_with_the_new_one(override, says, capfd):
    assert run("execute", ["scene=random", override]) == 2
    assert capfd.readouterr().err.strip() == f"dore-execute: {says}"


@pytest.mark.parametrize(
    ("override", "says"),
    [
        ("paper=sequential", "paper: renamed, want experiment=paper/single, experiment=paper/sequential or "),
        ("experiment=paper/table4", "experiment=paper/table4: renamed, want experiment=paper/single or "),
    ],
)
def test_an_old_preset_is_refused_with_the_new_ones(override, says, capfd):
    assert run("train", [override]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith(f"dore-train: {says}")


def test_the_new_names_exist():
    config = compose("execute", [])
    for key in KEYS.values():
        assert "=" in key or OmegaConf.select(config, key.split(",")[0]) is not None, key
    for option in re.findall(r"[\w/]+=[\w/]+", " ".join([*KEYS.values(), *OPTIONS.values()])):
        assert (conf_dir() / f"{option.replace('=', '/')}.yaml").exists(), option


def test_other_errors_are_left_alone():
    assert hint("Could not override 'camera.widht'") is None
    assert hint("Could not find 'camera/none_such'") is None
