"""Times the loop of one training run: environment steps and updates a second, and where the time goes.

python scripts/bench_training.py [--seconds 15] [--processes 1] [--name NAME] OVERRIDES OF dore-train...
Prints one line of JSON. It measures whichever tree of dore comes first on PYTHONPATH, an older one too; so it imports
nothing else of this folder. scripts/training_speed.sh has the runs behind docs/results/training_speed.md.
"""

from __future__ import annotations

import argparse
import json
import logging
import multiprocessing
import os
import platform
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from typing import Any, NamedTuple

import hydra
import torch
from hydra.errors import HydraException
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from dore import training
from dore.errors import InputError, number, whole
from dore.paths import conf_dir
from dore.run_folder import commit
from dore.session import trainer_of
from dore.training import Trainer

# TorchRL tells of its storage on standard output.
logging.getLogger("torchrl").setLevel(logging.WARNING)

WARM_UP = 10
"""Iterations that learn before those that count."""
REST = "rest"
STAGES = (
    *("policy", "environment step", "storing", "sampling", "decoding"),
    *("loss", "backward", "clipping", "optimiser", "targets", "mean of weights", REST),
)
"""Of an iteration, in the order in which they come. decoding: observations and masks; loss: the forward passes, the
target networks' too; rest: what is in no other."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=15.0, help="how long, after the start")
    parser.add_argument("--processes", type=int, default=1, help="so many such runs at once, added up")
    parser.add_argument("--name", help="of the line; the overrides unless given")
    parser.add_argument("overrides", nargs="*")
    chosen = parser.parse_args(arguments)
    try:
        number("--seconds", chosen.seconds, above=0.0)
        whole("--processes", chosen.processes, 1)
        cfg = composed(chosen.overrides)
        if cfg.device != "cpu":
            raise InputError(f"device: got {cfg.device!r}, want cpu: a GPU is still at work when its stage ends")
        runs = together(chosen.overrides, chosen.seconds, chosen.processes)
    except (InputError, HydraException, OmegaConfBaseException) as error:
        print(f"bench_training: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    named = {"name": chosen.name or " ".join(chosen.overrides), "overrides": chosen.overrides}
    print(json.dumps({**named, **about(cfg), **figures(runs, cfg.training.batch_size)}), flush=True)
    return 0


def composed(overrides: Sequence[str]) -> DictConfig:
    """The config of dore-train."""
    with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
        return hydra.compose("train", [*overrides, "logger=none"])


class Measured(NamedTuple):
    """One process's share. load: of the machine, at the start and at the end of what counts."""

    seconds: float
    cpu_seconds: float
    env_steps: int
    updates: int
    stages: dict[str, float]
    threads: int
    load: tuple[float, float]


class Stages:
    """A stopwatch for each stage; of a stage within another the time counts once, for the inner one."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(STAGES, 0.0)
        self._inner = [0.0]

    def timed(self, stage: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """The same call, its time added to a stage."""

        def run(*given: Any, **named: Any) -> Any:
            self._inner.append(0.0)
            began = time.perf_counter()
            try:
                return call(*given, **named)
            finally:
                taken = time.perf_counter() - began
                self.seconds[stage] += taken - self._inner.pop()
                self._inner[-1] += taken

        return run


def together(overrides: Sequence[str], seconds: float, processes: int) -> list[Measured]:
    """The same run in so many new processes, which begin to count at once."""
    context = multiprocessing.get_context("spawn")
    start = context.Barrier(processes)
    with ProcessPoolExecutor(processes, context, initializer=_begin, initargs=(start,)) as pool:
        return list(pool.map(_run, repeat(list(overrides), processes), repeat(seconds)))


def _begin(start: Any) -> None:
    globals()["_start"] = start


def _run(overrides: list[str], seconds: float) -> Measured:
    """One process: start, warm up, wait for the others, count."""
    trainer = trainer_of(composed(overrides))
    shown = trainer.env.reset()
    while not trainer.progress.updates:
        shown = trainer.iterate(shown)
    for _ in range(WARM_UP):
        shown = trainer.iterate(shown)
    stages = Stages()
    # The process ends after this: nothing is put back.
    for stage, owner, name in _calls(trainer):
        setattr(owner, name, stages.timed(stage, getattr(owner, name)))
    progress = trainer.progress
    steps, updates = progress.env_steps, progress.updates
    globals()["_start"].wait()
    load, cpu, began = os.getloadavg()[0], time.process_time(), time.perf_counter()
    while (taken := time.perf_counter() - began) < seconds:
        shown = trainer.iterate(shown)
    cpu = time.process_time() - cpu
    stages.seconds[REST] = taken - sum(stages.seconds.values())
    counts = progress.env_steps - steps, progress.updates - updates
    return Measured(taken, cpu, *counts, stages.seconds, torch.get_num_threads(), (load, os.getloadavg()[0]))


def _calls(trainer: Trainer) -> Iterable[tuple[str, object, str]]:
    """Stage, owner and name of each call that an iteration is made of."""
    yield from (
        ("policy", trainer.agent, "policy"),
        ("environment step", trainer.env, "step_and_maybe_reset"),
        ("storing", training, "compact"),
        ("storing", trainer.buffer, "extend"),
        ("sampling", trainer.buffer, "sample"),
        ("sampling", training, "restore"),
        ("decoding", trainer.agent, "decode"),
        ("loss", trainer.agent.loss, "forward"),
        ("backward", torch.Tensor, "backward"),
        ("clipping", torch.nn.utils, "clip_grad_norm_"),
        ("optimiser", trainer.optimizer, "zero_grad"),
        ("optimiser", trainer.optimizer, "step"),
        ("targets", trainer.targets, "step"),
    )
    # Older trees keep no mean.
    if hasattr(trainer, "averaged"):
        yield "mean of weights", trainer.averaged, "step"


def about(cfg: DictConfig) -> dict[str, Any]:
    """What was measured, and on what."""
    return {
        "board": f"{cfg.layout.rows}x{cfg.layout.cols}",
        "obstacles": [cfg.instances.min_obstacles, cfg.instances.max_obstacles],
        "batch_size": cfg.training.batch_size,
        "updates_per_step": cfg.training.updates_per_step,
        "num_envs": cfg.env.num_envs,
        "commit": commit(),
        "torch": torch.__version__,
        "machine": platform.machine(),
        "cores": os.cpu_count(),
    }


def figures(runs: Sequence[Measured], batch_size: int) -> dict[str, Any]:
    """Counts of all processes together; seconds are the mean of theirs."""
    n = len(runs)
    seconds = sum(one.seconds for one in runs) / n
    env_steps, updates = sum(one.env_steps for one in runs), sum(one.updates for one in runs)
    stages = {stage: sum(one.stages[stage] for one in runs) / n for stage in STAGES}
    return {
        "processes": n,
        "threads": runs[0].threads,
        "load": [min(one.load[0] for one in runs), max(one.load[1] for one in runs)],
        "seconds": seconds,
        "cpu_seconds": sum(one.cpu_seconds for one in runs) / n,
        "env_steps": env_steps,
        "updates": updates,
        "env_steps_per_s": env_steps / seconds,
        "updates_per_s": updates / seconds,
        "samples_per_s": updates * batch_size / seconds,
        "stages": stages,
        "shares": {stage: taken / seconds for stage, taken in stages.items()},
    }


if __name__ == "__main__":
    sys.exit(main())
