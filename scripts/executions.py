"""Carries out many random scenes on the simulated arm, several at a time, each in a folder of its own.

python -m scripts.executions OUT [--obstacles 5,7,9] [--runs 100] [--planner guided] [--loop open] [--seed 7] ...
What is done is skipped, so a run that was stopped goes on. The scenes are the first ones of the seed's test split
that the planners of --solved-by have plans for. `dore-report study=execution` makes the page from the reports.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import hydra
import torch
from omegaconf import DictConfig
from tqdm import tqdm

from dore.app import build
from dore.app.execute import closed_loop_of, open_loop_of, setup_of
from dore.configure import make
from dore.errors import InputError, whole
from dore.files import atomic_write, conf_dir
from dore.planners.base import label
from dore.sim.run.execution import execute
from dore.sim.run.setup import REPORT_NAME
from dore.sim.scene.agent import render_backend
from dore.sim.vision.camera import RgbdCamera
from dore.world.generator import Difficulty
from dore.world.instances import InstanceSet
from dore.world.plan import Status
from dore.world.problem import Problem, Scene

ARGUMENTS = "arguments.json"
_KEPT: list[Any] = []


@dataclass(frozen=True)
class Job:
    """One execution: overrides of dore-execute, the scene, and where its report goes."""

    overrides: tuple[str, ...]
    scene: Scene
    folder: Path


def main(arguments: list[str] | None = None) -> None:
    """Run what is not done yet."""
    chosen = _arguments(arguments)
    _note_arguments(chosen)
    jobs = [job for obstacles in chosen.obstacles for job in _jobs(chosen, obstacles)]
    todo = [job for job in jobs if not finished(job.folder)]
    print(f"{len(jobs) - len(todo)} of {len(jobs)} executions are done in {chosen.out}")
    # Not forked: SAPIEN's renderer does not survive it.
    begin = _keep_rendering if chosen.loop == "closed" else None
    with multiprocessing.get_context("spawn").Pool(chosen.workers, initializer=begin) as pool:
        for _ in tqdm(pool.imap_unordered(_carry_out, todo), total=len(todo), unit="plan"):
            pass


def _arguments(given: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of the executions")
    parser.add_argument("--obstacles", default="5,7,9", help="numbers of obstacles, separated by commas")
    parser.add_argument("--runs", type=int, default=100, help="scenes for each number of obstacles")
    parser.add_argument("--planner", default="guided", help="who plans")
    parser.add_argument("--solved-by", default="exact", help="planners that must have a plan for a scene")
    parser.add_argument("--candidates", type=int, help="how many scenes these are looked for in; 4 times --runs")
    parser.add_argument("--loop", default="open", choices=["open", "closed"])
    parser.add_argument("--disturbance", default="none", help="none, moved, slip, intruder, or mixed: each in turn")
    parser.add_argument("--seed", type=int, default=7, help="of the scenes")
    parser.add_argument("--workers", type=int, default=2, help="executions at a time")
    parser.add_argument("--set", action="append", default=[], help="a further override of dore-execute")
    chosen = parser.parse_args(given)
    try:
        chosen.obstacles = [whole("--obstacles", int(one), 1) for one in chosen.obstacles.split(",")]
        whole("--runs", chosen.runs, 1)
        whole("--workers", chosen.workers, 1)
    except (InputError, ValueError) as error:
        parser.error(str(error))
    return chosen


def _note_arguments(chosen: argparse.Namespace) -> None:
    """What the runs are, for the page; a folder holds runs of one kind.

    Raises:
        InputError: the folder holds others.
    """
    kind = {name: value for name, value in vars(chosen).items() if name not in ("out", "workers", "obstacles", "runs")}
    file = chosen.out / ARGUMENTS
    if file.exists():
        if json.loads(file.read_text()) != kind:
            raise InputError(f"{chosen.out}: holds executions of another kind, {file} says which")
        return
    chosen.out.mkdir(parents=True, exist_ok=True)
    with atomic_write(file) as opened:
        json.dump(kind, opened, indent=2)


def finished(folder: Path) -> bool:
    """Whether an execution came to its end there."""
    report = folder / REPORT_NAME
    return report.exists() and json.loads(report.read_text())["finished"]


def composed(overrides: tuple[str, ...]) -> DictConfig:
    """The config of dore-execute."""
    with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
        return hydra.compose("execute", list(overrides))


def _jobs(chosen: argparse.Namespace, obstacles: int) -> list[Job]:
    kinds = ["moved", "slip", "intruder"] if chosen.disturbance == "mixed" else [chosen.disturbance]
    scenes = solvable_scenes(
        chosen.solved_by.split(","), obstacles, chosen.runs, chosen.candidates or 4 * chosen.runs, chosen.seed
    )
    return [
        Job(
            (f"planner={chosen.planner}", f"loop={chosen.loop}", f"disturbance={kinds[number % len(kinds)]}",
             f"seed={number}", *chosen.set),
            scene,
            chosen.out / f"z{obstacles}" / f"{number:03d}",
        )
        for number, scene in enumerate(scenes)
    ]  # fmt: skip


def solvable_scenes(planners: list[str], obstacles: int, count: int, candidates: int, seed: int) -> list[Scene]:
    """The first `count` of so many scenes of the test split that all of the planners have a plan for.

    Raises:
        InputError: there are too few.
    """
    reach = build.reach_of(composed(()), "cpu")
    instances = InstanceSet.generate(reach, candidates, Difficulty(obstacles, obstacles), "test", seed)
    solved = torch.ones(len(instances), dtype=torch.bool)
    for name in planners:
        labels = label(instances, build.planner_of(composed((f"planner={name}",)), reach))
        solved &= torch.tensor([status is Status.SOLVED for status in labels.status])
    rows = solved.nonzero().squeeze(-1).tolist()[:count]
    if len(rows) < count:
        raise InputError(f"--runs: {count}, but only {len(rows)} of {len(instances)} scenes are solved by all")
    print(f"{obstacles} obstacles: {count} of the first {rows[-1] + 1} scenes are solved by {', '.join(planners)}")
    problems = list(instances)
    return [problems[row].scene for row in rows]


def _keep_rendering() -> None:
    """One environment stays open in each process: without any, the next one compiles its shaders again, 10 s."""
    cfg = composed(())
    setup = setup_of(cfg, film=False)
    env = setup.environment(make(cfg.layout, "layout"), setup.bodies(1), render_backend())
    env.reset(options={"cells": [0]})
    RgbdCamera(env, seed=0).look()
    _KEPT.append(env)


def _carry_out(job: Job) -> None:
    """One execution, in a process of its own, on one thread."""
    torch.set_num_threads(1)
    cfg = composed(job.overrides)
    problem = Problem(job.scene, build.reach_of(cfg, "cpu", job.scene.layout))
    shutil.rmtree(job.folder, ignore_errors=True)
    loop = (closed_loop_of if cfg.loop == "closed" else open_loop_of)(cfg, problem)
    execute(loop, setup_of(cfg, film=False), job.folder)


if __name__ == "__main__":
    main()
