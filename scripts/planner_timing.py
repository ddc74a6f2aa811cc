"""What scripts/bench_planners.py measures with."""

from __future__ import annotations

import itertools
import os
import subprocess
import time
from collections.abc import Sequence
from statistics import median
from typing import NamedTuple

import hydra
from omegaconf import DictConfig
from tqdm import tqdm

from dore.app import build
from dore.files import conf_dir
from dore.planners.base import Planner
from dore.world.generator import Difficulty
from dore.world.instances import InstanceSet
from dore.world.plan import Plan
from dore.world.problem import Batch


class Timed(NamedTuple):
    """A plan, and the wall and CPU seconds it took."""

    plan: Plan
    seconds: float
    cpu_seconds: float


class Size(NamedTuple):
    """A board, its instances, and which of them: those of the test split of a seed."""

    layout: str
    obstacles: Difficulty
    instances: int
    seed: int


def world(size: Size, names: Sequence[str], model: str | None) -> tuple[list[Planner], InstanceSet]:
    """Planners as dore-evaluate makes them, and instances of the test split.

    Raises:
        InputError: no such model, or one of another layout.
    """
    given = [f"model={model}"] if model else []
    cfg = composed([f"layout={size.layout}", "reach=wide_hand", f"planner=[{','.join(names)}]", *given])
    reach = build.reach_of(cfg, "cpu")
    instances = InstanceSet.generate(reach, size.instances, size.obstacles, "test", size.seed)
    return build.planners_of(cfg, reach), instances


def composed(overrides: list[str]) -> DictConfig:
    """The config of dore-evaluate."""
    with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
        return hydra.compose("evaluate", overrides)


def one_at_a_time(planners: Sequence[Planner], instances: InstanceSet) -> list[list[Timed]]:
    """For each planner its plans of all instances; the planners take turns, after one that does not count."""
    rows: list[list[Timed]] = [[] for _ in planners]
    for planner in planners:
        planner.plan(instances.batch(slice(1)))
    turns = itertools.product(range(len(instances)), zip(planners, rows, strict=True))
    for number, (planner, made) in tqdm(turns, total=len(planners) * len(instances), unit="plan"):
        made.append(timed(planner, instances.batch(slice(number, number + 1))))
    return rows


def timed(planner: Planner, alone: Batch) -> Timed:
    """One plan."""
    began, cpu_began = time.perf_counter(), time.process_time()
    (plan,) = planner.plan(alone)
    return Timed(plan, time.perf_counter() - began, time.process_time() - cpu_began)


def process_seconds(*command: str) -> float:
    """Median wall seconds of a program with one thread, run three times."""
    taken = []
    for _ in range(3):
        began = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True, env={**os.environ, "OMP_NUM_THREADS": "1"})
        taken.append(time.perf_counter() - began)
    return median(taken)
