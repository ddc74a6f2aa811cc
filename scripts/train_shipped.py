"""Trains the model that ships inside the package: one separated DQN for every layout, on mixed boards in turn.

python -m scripts.train_shipped [--minutes 30] [--out outputs/generalist/generalist.safetensors]

Each world below is an environment, a buffer and a test of its own; the networks, their mean, the optimiser and the
targets are one. The weights kept are those of the lowest mean IPT cost over all worlds, on validation splits. What is
to ship is copied to dore/weights by hand, weights and JSON.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import hydra
import torch
from hydra.errors import HydraException
from omegaconf import OmegaConf
from tqdm import tqdm

from dore.app import build
from dore.app.session import trainer_of
from dore.errors import InputError, number
from dore.files import atomic_write, commit, conf_dir
from dore.learn.agents.sequential import Sequential
from dore.learn.checkpoint import save_model
from dore.learn.trainer import Diverged, Trainer

WORLDS = (
    "layout=8x8 instances=z3-13 reach=wide_hand",
    "layout=6x6 instances=z3-9 reach=wide_hand",
    "layout=3x6 instances=z3-9 reach=wide_hand",
    "layout=7x7 instances=z3-10 reach=paper_fit",
    "layout=3x6 instances=z3-9 reach=paper_fit",
    "layout=6x6 instances=z3-9 reach=paper_fit",
    "layout=3x6 instances=z3-9 reach=panda_slim",
)
SHARED = (
    "agent=sequential agent.encoding=lanes agent.symmetry=false network=cells env.num_envs=128 "
    "training.batch_size=128 training.precision=bfloat16 exploration.anneal_steps=20000 "
    "ipt.n_batches=2 ipt.target_success=1.0 logger=none"
)
"""Without mirror images: cells that are told apart by their lanes alone look the same in them."""
LAST_RATE = 0.05
"""The learning rate falls in a straight line to this share of what it was."""


@dataclass
class Course:
    """The worlds' trainers, which share one agent."""

    trainers: list[Trainer]
    rate: float
    best: float = math.inf
    tests: list[dict[str, float]] = field(default_factory=list)


def main(arguments: Sequence[str] | None = None) -> int:
    """Train, test now and then, keep the best, and write the model card's figures beside it; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--test-minutes", type=float, default=2.5, help="between two tests")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("outputs/generalist/generalist.safetensors"))
    parser.add_argument("overrides", nargs="*", help="of every world, for tests")
    chosen = parser.parse_args(arguments)
    try:
        for name in ("minutes", "test_minutes"):
            number(f"--{name.replace('_', '-')}", getattr(chosen, name), above=0.0)
        _train(chosen)
    except (InputError, HydraException, Diverged) as error:
        print(f"train_shipped: {' '.join(str(error).split())}", file=sys.stderr)
        return 1 if isinstance(error, Diverged) else 2
    return 0


def _train(chosen: argparse.Namespace) -> None:
    course, config = _course(chosen.seed, chosen.overrides)
    began = tested = time.perf_counter()
    with tqdm(total=round(60 * chosen.minutes), unit="s") as bar:
        while (now := time.perf_counter()) - began < 60 * chosen.minutes:
            fallen = (now - began) / (60 * chosen.minutes)
            course.trainers[0].optimizer.param_groups[0]["lr"] = course.rate * (1 - (1 - LAST_RATE) * fallen)
            for trainer in course.trainers:
                trainer.iterate()
            bar.n = round(now - began)
            bar.set_postfix_str(f"best cost {course.best:.4f}, loss {course.trainers[0].progress.loss:.3f}")
            if now - tested > 60 * chosen.test_minutes:
                _test(course, config, chosen.out, now - began)
                tested = time.perf_counter()
    _test(course, config, chosen.out, time.perf_counter() - began)


def _course(seed: int, overrides: list[str]) -> tuple[Course, dict[str, Any]]:
    """One trainer a world; the first one's agent, optimiser and targets serve all."""
    trainers: list[Trainer] = []
    config: dict[str, Any] = {}
    for world in WORLDS:
        with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
            cfg = hydra.compose("train", [*world.split(), *SHARED.split(), f"seed={seed}", *overrides])
        trainer = trainer_of(cfg)
        if trainers:
            trainer.agent = cast(Sequential, trainers[0].agent).on(build.reach_of(cfg, cfg.device))
            trainer.player.agent = trainer.agent
            trainer.optimizer, trainer.targets = trainers[0].optimizer, trainers[0].targets
            trainer.averaged = trainers[0].averaged
        else:
            plain = cast(dict[str, Any], OmegaConf.to_container(cfg, resolve=True))
            config = {name: plain[name] for name in (*build.MODEL, "seed")}
        trainers.append(trainer)
    torch.manual_seed(seed)
    return Course(trainers, trainers[0].optimizer.param_groups[0]["lr"]), config


def _test(course: Course, config: dict[str, Any], out: Path, seconds: float) -> None:
    """An IPT of every world; the weights are kept if they are the best so far."""
    results = [trainer.run_test() for trainer in course.trainers]
    mean = sum(result.cost for result in results) / len(results)
    named = {world: result.success for world, result in zip(WORLDS, results, strict=True)}
    updates = sum(trainer.progress.updates for trainer in course.trainers)
    course.tests.append({"seconds": seconds, "updates": updates, "mean_cost": mean, **named})
    tqdm.write(json.dumps(course.tests[-1]))
    if mean < course.best:
        course.best = mean
        out.parent.mkdir(parents=True, exist_ok=True)
        save_model(out, course.trainers[0].averaged.weights(), config)
    about = {"commit": commit(), "torch": torch.__version__, "seed": config["seed"], "tests": course.tests}
    with atomic_write(out.with_suffix(".json")) as file:
        json.dump(about, file, indent=2)


if __name__ == "__main__":
    sys.exit(main())
