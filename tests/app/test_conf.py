"""Every option of every group composes and builds."""

from __future__ import annotations

from pathlib import Path

import hydra
import pytest
from hydra.core.global_hydra import GlobalHydra

from dore.app import build
from dore.app.session import trainer_of
from dore.configure import make
from dore.files import conf_dir

GROUPS = ("layout", "reach", "instances", "env", "network", "agent", "buffer", "exploration", "optimizer", "column")
SMALL = ("instances.validation_size=20", "instances.test_size=20", "ipt.batch_size=20", "env.num_envs=4", "logger=none")


def compose(command: str, overrides: list[str]):
    GlobalHydra.instance().clear()
    with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
        return hydra.compose(command, overrides)


def options(group: str) -> list[str]:
    root = conf_dir() / group
    paths = (path for path in root.rglob("*.yaml") if not path.name.startswith("_"))
    return sorted(str(path.relative_to(root).with_suffix("")) for path in paths)


OPTIONS = [f"{group}={option}" for group in (*GROUPS, "target_update") for option in options(group)]


@pytest.mark.parametrize("option", OPTIONS)
def test_every_option_trains(option):
    more = ["layout=8x8"] if option == "instances=z3-13" else []
    trainer = trainer_of(compose("train", [option, *more, *SMALL]))
    trainer.iterate()
    assert trainer.progress.env_steps == trainer.env.batch_size[0]


@pytest.mark.parametrize("experiment", options("experiment"))
def test_every_experiment_builds(experiment):
    train_size = ["instances.train_size=50"] if experiment.startswith(("paper/", "ablation/")) else []
    trainer_of(compose("train", [f"experiment={experiment}", *train_size, *SMALL]))


@pytest.mark.parametrize("paper", options("paper"))
def test_every_column_of_table_5_builds(paper):
    trainer_of(compose("train", [f"paper={paper}", "instances.train_size=50", *SMALL]))


@pytest.mark.parametrize("planner", options("planner"))
def test_every_planner_builds(planner):
    cfg = compose("evaluate", [f"planner={planner}", "layout=3x6", "reach=wide_hand", "instances=z3-7"])
    reach = build.reach_of(build.world_of(cfg, None), "cpu")
    (made,) = build.planners_of(cfg, reach)
    assert made.name == planner


EXECUTE_GROUPS = ("arm", "objects", "view", "camera", "disturbance")


@pytest.mark.parametrize("option", [f"{group}={name}" for group in EXECUTE_GROUPS for name in options(group)])
def test_every_option_of_an_execution_builds(option):
    group = option.partition("=")[0]
    make(compose("execute", [option])[group], group)


def test_every_config_file_explains_itself():
    """What a reader opens says what it is for, or what its keys mean."""
    silent = []
    for path in sorted(Path(conf_dir()).rglob("*.yaml")):
        lines = path.read_text(encoding="utf-8").splitlines()
        told = any(line.lstrip().startswith("#") and "@package" not in line for line in lines)
        if not told:
            silent.append(str(path.relative_to(conf_dir())))
    assert silent == []
