"""From a composed config to the objects it names. Everything is built, and so checked, before long work starts."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import torch
from omegaconf import DictConfig, OmegaConf

from dore.app.own_parts import cells_stay
from dore.configure import make
from dore.errors import InputError, path_of, shown, whole
from dore.learn.checkpoint import SHIPPED, load_model
from dore.planners.base import Planner
from dore.world.instances import InstanceSplits
from dore.world.layout import Layout
from dore.world.reach import Reach
from dore.world.scene_files import SceneInstances

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
    splits: InstanceSplits = make(config.get("instances"), "instances")
    if isinstance(splits, InstanceSplits):
        splits.difficulty.check_fits(reach.n_cells)
    return splits


def planners_of(cfg: DictConfig, reach: Reach) -> list[Planner]:
    """The planners that the config names.

    Raises:
        InputError: it names none, or its section `planners` is a value.
    """
    check_sections(cfg, "planners")
    if not cfg.planners:
        raise InputError("planners: got none, want one or more (planner=NAME)")
    return [make(node, f"planner {name}", reach=reach) for name, node in cfg.planners.items()]


def planner_of(cfg: DictConfig, reach: Reach) -> Planner:
    """The one planner that the config names.

    Raises:
        InputError: it names several, or none.
    """
    planners = planners_of(cfg, reach)
    if len(planners) != 1:
        raise InputError(f"planner: got {len(planners)}, want one")
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


def model_config(cfg: DictConfig) -> Mapping[str, Any]:
    """What the given model was made with, or the one in the package."""
    return load_model(SHIPPED if cfg.model is None else path_of("model", cfg.model))[1]


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
    torch.set_num_threads(whole("threads", threads, 1, at_most=256))
