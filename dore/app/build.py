"""From a composed config to the objects it names. Everything is built, and so checked, before long work starts."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from omegaconf import DictConfig, OmegaConf

from dore.app.models import Model, models_of, world_config
from dore.app.own_parts import cells_stay
from dore.configure import make
from dore.errors import InputError, shown, whole
from dore.planners.base import Planner
from dore.world.layout import Layout
from dore.world.reach import Reach
from dore.world.scene_files import SceneInstances

if TYPE_CHECKING:  # torch, which dore-plan does without where it can.
    from dore.world.benchmark import Benchmark
    from dore.world.instances import InstanceSplits

WORLD = ("layout", "reach", "instances")
MODEL = (*WORLD, "agent", "network")
"""The groups that a model file keeps: what is needed to build its networks again, and what they learned from."""


def reach_of(config: Mapping[str, Any], device: str, layout: Layout | None = None) -> Reach:
    """The accessibility check of a layout, the config's unless one is given."""
    layout = layout or make(config.get("layout"), "layout")
    reach: Reach = make(config.get("reach"), "reach", layout=layout)
    return reach.to(device)


def splits_of(config: Mapping[str, Any], reach: Reach) -> InstanceSplits:
    """The instance splits, checked against the layout."""
    from dore.world.instances import InstanceSplits

    splits: InstanceSplits = make(config.get("instances"), "instances")
    if isinstance(splits, InstanceSplits):
        splits.difficulty.check_fits(reach.n_cells)
    return splits


def benchmark_of(config: Mapping[str, Any]) -> Benchmark | None:
    """The benchmark, if a config's instances are it; it brings its own layouts and reaches."""
    from dore.world.benchmark import Benchmark

    node = config.get("instances")
    named = isinstance(node, Mapping) and node.get("_target_") == f"{Benchmark.__module__}.{Benchmark.__qualname__}"
    return make(node, "instances") if named else None


def planners_of(cfg: DictConfig, reach: Reach) -> list[Planner]:
    """The planners that the config names.

    Raises:
        InputError: it names none, or its section `planners` is a value.
    """
    check_sections(cfg, "planners")
    if not cfg.planners:
        raise InputError("planners: got none, want one or more (planner=NAME)")
    return [planner for name, node in cfg.planners.items() for planner in _by_model(str(name), node, reach)]


def groups_of(cfg: DictConfig) -> dict[str, str]:
    """Each planner's name without the seed of its model; empty where no planner has several models."""
    named = [pair for name, node in cfg.planners.items() for pair in _models(str(name), node)]
    return {f"{name} {one.label}": f"{name} {one.group}" for name, one in named if one.label}


def _by_model(name: str, node: Any, reach: Reach) -> list[Planner]:
    """A planner for each model that its config names, called as the config calls it."""
    planners = []
    for _, one in _models(name, node):
        more = {"model": one.path} if isinstance(node, DictConfig) and "model" in node else {}
        planner: Planner = make(OmegaConf.merge(node, more) if more else node, f"planner {name}", reach=reach)
        planner.name = f"{name} {one.label}".strip()
        planners.append(planner)
    return planners


def _models(name: str, node: Any) -> list[tuple[str, Model]]:
    """A planner's models, each with the planner's name; one without a path where its config names none."""
    several = isinstance(node, DictConfig) and "model" in node
    return [(name, one) for one in (models_of(node.model) if several else [Model(None)])]


def planner_of(cfg: DictConfig, reach: Reach) -> Planner:
    """The one planner that the config names.

    Raises:
        InputError: it names several, or none.
    """
    planners = planners_of(cfg, reach)
    if len(planners) != 1:
        raise InputError(f"planner: got {shown([one.name for one in planners])}, want one")
    return planners[0]


def world_of(cfg: DictConfig, model: Mapping[str, Any] | None) -> DictConfig:
    """layout, reach and instances: those of a model's config, overridden by what `cfg` gives; or own scenes' layout."""
    world = OmegaConf.create({name: (model or {}).get(name) for name in WORLD})
    for name in WORLD:
        given = cfg.get(name)
        if given is not None:
            # A whole preset replaces the model's; single keys, as an arm's front_m, change it.
            world[name] = given if "_target_" in given else OmegaConf.merge(world[name] or {}, given)
    if world.layout is not None:
        cells_stay(world.layout)
    if cfg.get("instances") is not None and isinstance(scenes := make(world.instances, "instances"), SceneInstances):
        world.instances.path = os.path.abspath(scenes.path)
        if "_target_" not in (cfg.get("layout") or {}):
            world.layout = {"_target_": "dore.world.layout.Layout.from_dict", "data": scenes.layout.to_dict()}
    return world


def model_config(cfg: DictConfig, parts: Sequence[str] = WORLD) -> Mapping[str, Any]:
    """These parts of the config of the given models, or of the one in the package."""
    return world_config(models_of(cfg.model), cfg, parts)


def check_sections(cfg: DictConfig, *names: str) -> None:
    """Refuse a config in which a section is a value.

    Raises:
        InputError: names the first such section.
    """
    for name in names:
        node = OmegaConf.select(cfg, name)
        if not isinstance(node, DictConfig):
            raise InputError(f"{name}: got {shown(node)}, want a section with keys of its own")


def use_threads(threads: int) -> None:
    """How many CPU threads torch may use."""
    threads = whole("threads", threads, 1, at_most=256)
    os.environ["OMP_NUM_THREADS"] = str(threads)  # Where torch is loaded later, if at all.
    if "torch" in sys.modules:
        import torch

        torch.set_num_threads(threads)
