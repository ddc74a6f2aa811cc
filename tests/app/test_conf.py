"""Every option of every group composes and builds."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import hydra
import pytest
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser

from dore.app import build
from dore.app.training import trainer_of
from dore.configure import make
from dore.files import conf_dir
from dore.learn.trainer import MAIN

ROOT = Path(__file__).parents[2]
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
for nothing_to_train_on in ("instances=file", "instances=benchmark"):  # tests/app/test_own_scenes.py, test_benchmark.py
    OPTIONS.remove(nothing_to_train_on)


@pytest.mark.parametrize("option", OPTIONS)
def test_every_option_trains(option):
    more = ["layout=8x8"] if option == "instances=z3-13" else []
    trainer = trainer_of(compose("train", [option, *more, *SMALL]))
    trainer.iterate()
    assert trainer.progress.env_steps == trainer.worlds[MAIN].env.batch_size[0]


@pytest.mark.parametrize("experiment", options("experiment"))
def test_every_experiment_builds(experiment):
    train_size = ["instances.train_size=50"] if experiment.startswith(("paper/", "ablation/")) else []
    cfg = compose("train", [f"experiment={experiment}", *train_size, *SMALL])
    for world in (cfg.get("worlds") or {}).values():
        world.instances.validation_size = 20
    trainer_of(cfg)


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


def commands() -> list[tuple[str, str]]:
    """(command, overrides) of each example in the comments of conf/ and on the pages. Those of the README are run."""
    texts = [*conf_dir().rglob("*.yaml"), *ROOT.glob("docs/*.md"), ROOT / "CONTRIBUTING.md"]
    pattern = re.compile(r"^(?:#.*)?\bdore-(train|evaluate|plan|execute) (.*)$", re.M)
    found = [pair for path in texts for pair in pattern.findall(path.read_text(encoding="utf-8"))]
    # "<date>" is a placeholder; a remark follows two spaces.
    found = [(name, re.sub(r"[<>]|  .*", "", line)) for name, line in found]
    kept = [(name, line) for name, line in found if "--" not in line and "hydra/" not in line and "`" not in line]
    return list(dict.fromkeys(kept))


@pytest.mark.parametrize(("command", "line"), commands())
def test_every_example_composes(command, line):
    overrides = [word for word in shlex.split(line, comments=True) if word != "-m"]
    GlobalHydra.instance().clear()
    with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
        parsed = OverridesParser.create(GlobalHydra.instance().config_loader()).parse_overrides(overrides)
        (jobs,) = BasicSweeper.split_arguments(parsed, max_batch_size=None)
        for job in jobs:
            hydra.compose(command, job)


def test_the_literal_sweep_is_the_whole_of_table_4():
    (overrides,) = {tuple(shlex.split(line, comments=True)) for _, line in commands() if "sweep=literal" in line}
    assert list(overrides[1:]) == ["experiment=paper/single,paper/sequential", "column=glob(*)", "sweep=literal"]
    assert options("column") == ["6x6_z3-5", "6x6_z3-8", "7x7_z3-10", "7x7_z3-5", "8x8_z3-13", "8x8_z3-5"]


@pytest.mark.parametrize("column", ["7x7_z3-5", "8x8_z3-13"])
@pytest.mark.parametrize("experiment", ["single", "sequential"])
def test_column_wins_over_the_experiments_own(experiment, column):
    cfg = compose("train", [f"experiment=paper/{experiment}", f"column={column}"])
    size, obstacles = column.split("_z3-")
    assert (f"{cfg.layout.rows}x{cfg.layout.cols}", str(cfg.instances.max_obstacles)) == (size, obstacles)


def test_every_config_file_explains_itself():
    """What a reader opens says what it is for, or what its keys mean."""
    silent = []
    for path in sorted(Path(conf_dir()).rglob("*.yaml")):
        lines = path.read_text(encoding="utf-8").splitlines()
        explained = any(line.lstrip().startswith("#") and "@package" not in line for line in lines)
        if not explained:
            silent.append(str(path.relative_to(conf_dir())))
    assert silent == []
