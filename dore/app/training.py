"""From a composed config to a trainer. Everything is built, and so checked, before long work starts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from omegaconf import DictConfig

from dore.app.build import WORLD, check_sections, reach_of, splits_of, use_threads
from dore.configure import call, make
from dore.errors import InputError, flag, number, path_of, seed_of, shown, whole
from dore.learn.agents.common import Agent, agent_from_config
from dore.learn.budget import Budget
from dore.learn.checkpoint import load_model
from dore.learn.learner import Learner
from dore.learn.memory import memory_for
from dore.learn.trainer import MAIN, Trainer
from dore.learn.worlds import World
from dore.world.instances import InstanceSplits
from dore.world.reach import Reach

SECTIONS = (
    *("training", "ipt", "env", "env.rewards", "instances", "agent", "buffer", "buffer.storage"),
    *("target_update", "optimizer", "exploration", "loggers"),
)
"""The sections of dore-train's config whose keys are looked at before they are built."""


def trainer_of(cfg: DictConfig) -> Trainer:
    """A training run's parts; seeds torch's generator, which weights, exploration and sampling draw from.

    Raises:
        InputError: what the config gives does not fit together.
    """
    _check_numbers(cfg)
    use_threads(cfg.threads)
    # Checked before the instances are drawn, which takes a minute where there are many.
    budget: Budget = make(cfg.training, "training")
    epsilon = make(cfg.exploration, "exploration")
    settings = {MAIN: _setting_of(cfg, cfg.device)}
    further = cfg.get("worlds", {})
    if not isinstance(further, Mapping):
        raise InputError(f"worlds: got {shown(further)}, want further worlds by their names, or {{}}")
    for name, node in further.items():
        settings[str(name)] = _further_setting(str(name), node, cfg.device)
    _check_slots(cfg, settings)
    torch.manual_seed(cfg.seed)
    agent = agent_from_config(cfg, settings[MAIN][0])
    if cfg.get("init") is not None:
        _begin_with(agent, path_of("init", cfg.init))
    learner = Learner(
        agent=agent,
        # The updater comes before the first loss: TorchRL warns otherwise.
        targets=call(make(cfg.target_update, "target_update"), "target_update", agent.loss),
        optimizer=call(make(cfg.optimizer, "optimizer"), "optimizer", agent.networks.parameters()),
        budget=budget,
    )
    worlds = {
        name: _trained_world(cfg, agent if name == MAIN else _on(agent, name, reach), reach, splits, budget)
        for name, (reach, splits) in settings.items()
    }
    return Trainer(learner, worlds, epsilon, budget)


def _begin_with(agent: Agent, model: Path) -> None:
    """Give an agent a model's weights.

    Raises:
        InputError: no such model, a damaged one, or one of other networks.
    """
    weights, _ = load_model(model)
    try:
        agent.networks.load_state_dict(weights)
    except RuntimeError as error:
        why = str(error).splitlines()[0]
        raise InputError(f"init: {model} is not for the networks of this config ({why})") from None
    agent.loss.restart_targets()


def _check_numbers(cfg: DictConfig) -> None:
    """Raise InputError for numbers that are wrong or do not fit together."""
    check_sections(cfg, *SECTIONS)
    seed_of("seed", cfg.seed)
    whole("log_every", cfg.log_every, 1)
    number("checkpoint_minutes", cfg.checkpoint_minutes, above=0.0)
    capacity = whole("buffer.storage.max_size", cfg.buffer.storage.max_size, 1)
    for name in ("fill", "learning_starts"):
        if whole(f"training.{name}", cfg.training[name], 0) > capacity:
            raise InputError(
                f"training.{name}: {cfg.training[name]} is more than buffer.storage.max_size {capacity} holds"
            )
    if (interval := cfg.target_update.get("value_network_update_interval")) is not None:
        whole("target_update.value_network_update_interval", interval, 0)
    if "tau" in cfg.target_update:
        number("target_update.tau", cfg.target_update.tau, above=0.0, at_most=1.0)
    if "lr" in cfg.optimizer:
        number("optimizer.lr", cfg.optimizer.lr, above=0.0, at_most=10.0)
    if cfg.optimizer.get("fused") is not None:
        flag("optimizer.fused", cfg.optimizer.fused)


def _check_slots(cfg: DictConfig, settings: Mapping[str, tuple[Reach, InstanceSplits]]) -> None:
    """Raise InputError where a world's instances may have more obstacles than agent=single has slots."""
    if "n_slots" not in cfg.agent:
        return
    n_slots = whole("agent.n_slots", cfg.agent.n_slots, 1)
    for name, (reach, splits) in settings.items():
        most = splits.most_obstacles(reach.n_cells)
        if n_slots < most:
            where = "" if name == MAIN else f" of worlds.{name}"
            raise InputError(f"agent.n_slots: {n_slots} is below the {most} obstacles that instances{where} may have")


def _setting_of(config: Mapping[str, Any], device: str) -> tuple[Reach, InstanceSplits]:
    """The reach and the instance splits of a world."""
    reach = reach_of(config, device)
    return reach, splits_of(config, reach)


def _further_setting(name: str, node: Any, device: str) -> tuple[Reach, InstanceSplits]:
    """Those of a further world; an error names it."""
    try:
        if name == MAIN:
            raise InputError(f"{MAIN} is the name of the world that layout, reach and instances give, want another")
        if not isinstance(node, Mapping) or set(node) != set(WORLD):
            given = ", ".join(map(str, node)) if isinstance(node, Mapping) else repr(node)
            raise InputError(f"got {given}, want {', '.join(WORLD)}")
        return _setting_of(node, device)
    except InputError as error:
        raise InputError(f"worlds.{name}: {error}") from None


def _on(agent: Agent, name: str, reach: Reach) -> Agent:
    """The learner's agent, with the same weights, on a further world's reach.

    Raises:
        InputError: its networks serve one layout only, or it learns from mirror images and the layout has none.
    """
    if not agent.serves_every_layout:
        raise InputError("worlds: this network serves one layout; want network=relations or cells, or no worlds")
    if agent.symmetry and reach.mirror is None:
        raise InputError(f"worlds.{name}: its layout has no mirror image, want agent.symmetry=false")
    return agent.on(reach)


def _trained_world(cfg: DictConfig, agent: Agent, reach: Reach, splits: InstanceSplits, budget: Budget) -> World:
    """One world of the run."""
    source = splits.train(reach, cfg.seed)
    with memory_for("env.num_envs", cfg.env.num_envs):
        env = make(cfg.env, "env", reach=reach, source=source)
    evaluator = make(cfg.ipt, "ipt", instances=splits.validation(reach))
    teacher = None if cfg.get("teacher") is None else call(make(cfg.teacher, "teacher"), "teacher", reach=reach)
    return World(env, agent, make(cfg.buffer, "buffer"), evaluator, budget, teacher)
