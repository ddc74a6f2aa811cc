"""What `import dore` offers: the parts of the commands as functions, each with the defaults of conf/."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from typing import Any

import hydra
import pandas as pd
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException, UnsupportedValueType

from dore.app import build
from dore.app.evaluate import BenchmarkEvaluation, evaluation_of
from dore.configure import make
from dore.errors import InputError, path_of, seed_of, shown
from dore.files import conf_dir, shipped_or
from dore.learn.agents.common import Agent
from dore.learn.env import RearrangeEnv
from dore.planners.learned import Learned
from dore.report.evaluation import benchmark_rows, rows_as_they_come
from dore.report.rows import ROW_COLUMNS
from dore.schema import nearest
from dore.world.files import read_scene, scene_of
from dore.world.generator import SPLITS
from dore.world.instances import FixedInstances
from dore.world.layout import Layout
from dore.world.plan import Plan
from dore.world.problem import Batch, Problem, Scene

Path = str | os.PathLike[str]
SETTINGS = ("split", "timing", "device", "threads", "planners")
"""Further keys of dore-evaluate that `evaluate` takes."""


def make_env(
    layout: str | Layout = "3x6",
    *,
    reach: str = "wide_hand",
    instances: str = "z3-7",
    split: str = "train",
    num_envs: int = 64,
    max_moves: int = 16,
    seed: int = 0,
    device: str = "cpu",
) -> RearrangeEnv:
    """The batched TorchRL environment, as dore-train builds it.

    Args:
        layout: an option of conf/layout, or a `Layout`.
        reach, instances: options of conf/reach and conf/instances.
        split: train: new instances all the time; validation or test: drawn from that split's set.
        num_envs: B.
        max_moves: step limit of an episode.
        seed: of the instances drawn.

    Raises:
        InputError: names the argument that is wrong.
    """
    chosen = {"layout": layout, "reach": reach, "instances": instances}
    for name, given in chosen.items():
        if given is None:
            raise InputError(f"{name}: got None, want one of its options")
    cfg = _composed("train", chosen, env={"num_envs": num_envs, "max_moves": max_moves})
    on = build.reach_of(cfg, device, layout if isinstance(layout, Layout) else None)
    splits, seed = build.splits_of(cfg, on), seed_of("seed", seed)
    if split not in SPLITS:
        raise InputError(f"split: got {shown(split)}, want one of {', '.join(SPLITS)}")
    source = splits.train(on, seed) if split == "train" else FixedInstances(getattr(splits, split)(on), seed)
    env: RearrangeEnv = make(cfg.env, "env", reach=on, source=source)
    return env


def plan(
    scene: Path | Mapping[str, Any] | Scene,
    planner: str = "exact",
    *,
    reach: str | None = None,
    model: Path | None = None,
    device: str = "cpu",
    **options: Any,
) -> Plan:
    """The replayed plan for one scene, as dore-plan makes it.

    Args:
        scene: a scene or plan file, the name of one of conf/scenes, what such a file holds, or a `Scene`.
        planner: an option of conf/planner.
        reach: an option of conf/reach; None: the model's.
        model: a run or a model file, for planners that use one and for the reach; None: the one in the package.
        options: keys of that planner, as `max_moves=40`.

    Raises:
        InputError: names the argument or the field that is wrong.
    """
    if not isinstance(planner, str):
        raise InputError(f"planner: got {shown(planner)}, want one of its options, by name")
    if isinstance(scene, Mapping):
        scene = scene_of(_plain(scene))
    elif not isinstance(scene, Scene):
        scene = read_scene(shipped_or(path_of("scene", scene), "scenes"))
    cfg = _composed("plan", {"planner": planner, "reach": reach}, model=model, **{f"planners.{planner}": options})
    world = build.world_of(cfg, build.model_config(cfg))
    problem = Problem(scene, build.reach_of(world, device, scene.layout))
    (found,) = build.planner_of(cfg, problem.reach).plan(Batch.of(problem))
    return found


def load_model(
    model: Path | None = None,
    *,
    layout: str | Layout | None = None,
    reach: str | None = None,
    device: str = "cpu",
) -> Agent:
    """A trained agent: `agent.policy` acts greedily in a `make_env` of the same layout, `agent.networks` holds weights.

    Args:
        model: a run or a model file; None: the one in the package, which serves every layout.
        layout, reach: what it is to act on; None: what it was trained on.

    Raises:
        InputError: no such model, a damaged one, or one of another layout.
    """
    cfg = _composed("evaluate", {"layout": layout, "reach": reach}, model=model)
    world = build.world_of(cfg, build.model_config(cfg))
    on = build.reach_of(world, device, layout if isinstance(layout, Layout) else None)
    agent = Learned(on, model, max_moves=1).agent
    agent.set_epsilon(0.0)
    return agent


def evaluate(
    planner: str | Sequence[str] = ("learned", "straight_line"),
    *,
    layout: str | None = None,
    reach: str | None = None,
    instances: str | None = None,
    model: Path | Sequence[Path | None] | None = None,
    limit: int | None = 100,
    **settings: Any,
) -> pd.DataFrame:
    """A row for each planner and instance, as dore-evaluate writes them to rows.csv (`dore.report.rows.Row`).

    Args:
        planner: one or several options of conf/planner.
        layout, reach, instances: options of conf/; None: the model's.
        model: as in dore-evaluate; a list makes a row label of each model.
        limit: the first so many instances, of each stratum on instances="benchmark"; None: all.
        settings: further keys of conf/evaluate.yaml: `SETTINGS`.

    Raises:
        InputError: names the argument that is wrong.
    """
    for name in settings:
        if name not in SETTINGS:
            raise InputError(f"{name}: no such key{nearest(name, SETTINGS)}; want {', '.join(SETTINGS)}")
    names = [planner] if isinstance(planner, str) else planner
    chosen = {"planner": names, "layout": layout, "reach": reach, "instances": instances}
    models = list(model) if isinstance(model, list | tuple) else model
    of = evaluation_of(_composed("evaluate", chosen, model=models, limit=limit, **settings))
    none = pd.DataFrame(columns=list(ROW_COLUMNS))
    if isinstance(of, BenchmarkEvaluation):
        return pd.DataFrame(benchmark_rows(*of, none))
    return pd.DataFrame(rows_as_they_come(of.planners, of.instances, of.timing, none, batch_size=1024))


def _composed(command: str, chosen: Mapping[str, object], **values: Any) -> DictConfig:
    """A command's config with these options of groups, and then these keys.

    Raises:
        InputError: no such option or key.
    """
    overrides = [
        f"{group}={_names(group, given)}" for group, given in chosen.items() if not isinstance(given, Layout | None)
    ]
    try:
        with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
            cfg = hydra.compose(command, overrides)
    except HydraException as error:
        raise InputError(" ".join(str(error).split("Config search path")[0].split())) from None
    for key, value in values.items():
        for last, one in value.items() if isinstance(value, Mapping) else [("", value)]:
            name = f"{key}.{last}".rstrip(".")
            try:
                OmegaConf.update(cfg, name, _plain(one), force_add=False)
            except UnsupportedValueType:
                raise InputError(f"{name}: got {shown(one)}, want a plain value") from None
            except OmegaConfBaseException:
                parent = OmegaConf.select(cfg, key) if last else cfg
                known = [str(known) for known in parent or () if not str(known).startswith("_")]
                raise InputError(f"{name}: no such key{nearest(last or key, known)}; want {', '.join(known)}") from None
    return cfg


def _names(group: str, given: object) -> str:
    """One or several options as Hydra takes them.

    Raises:
        InputError: no names, or one twice.
    """
    names = given if isinstance(given, list | tuple) and group == "planner" else [given]
    if not names or not all(isinstance(name, str) and re.fullmatch(r"[\w./-]+", name) for name in names):
        raise InputError(f"{group}: got {shown(given)}, want one of its options, by name")
    if len(set(names)) < len(names):
        raise InputError(f"{group}: got {shown(given)}, want each name once")
    return f"[{','.join(map(str, names))}]" if names is given else str(given)


def _plain(value: Any) -> Any:
    """Numbers and arrays of NumPy and torch, and paths, as the config files hold them."""
    if isinstance(value, Mapping):
        return {key: _plain(one) for key, one in value.items()}
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return os.fspath(value) if isinstance(value, os.PathLike) else value
