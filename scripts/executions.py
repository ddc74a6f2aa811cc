"""Carries out many random scenes on the simulated arm, several at a time, each in a folder of its own.

python -m scripts.executions out=FOLDER [obstacles=[5,7,9]] [runs=100] [planner=guided] [loop=open] [seed=7] ...
What is done is skipped, so a run that was stopped can be resumed. The scenes are the first of the seed's test split
that all planners of solved_by have plans for. `dore-report study=execution` makes the page from the reports.
"""

from __future__ import annotations

import multiprocessing
import shutil
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import torch
from tqdm import tqdm

from dore.app import build
from dore.app.execute import closed_loop_of, open_loop_of, setup_of
from dore.configure import make
from dore.errors import InputError, one_of
from dore.files import ABOUT_FILE, commit, read_record, write_record
from dore.report.frame import ARGUMENTS
from dore.sim.run.execution import run_loop
from dore.sim.run.setup import REPORT_NAME
from dore.sim.scene.agent import render_backend
from dore.sim.vision.camera import RgbdCamera
from dore.world.generator import Difficulty
from dore.world.instances import InstanceSet
from dore.world.plan import Status
from dore.world.problem import Problem, Scene
from scripts.program import composed, run

_KEPT: list[Any] = []


@dataclass(frozen=True)
class Options:
    """out: the folder of the executions. runs: scenes for each number of obstacles.

    solved_by: the planners that must have a plan for a scene. disturbance: one of dore-execute's, or mixed: each in
    turn. seed: of the scenes. workers: executions at a time. overrides: more of them for dore-execute.
    """

    out: Path
    obstacles: list[int] = field(default_factory=lambda: [5, 7, 9])
    runs: int = 100
    planner: str = "guided"
    solved_by: list[str] = field(default_factory=lambda: ["exact"])
    loop: str = "open"
    disturbance: str = "none"
    seed: int = 7
    workers: int = 2
    overrides: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        one_of("loop", self.loop, Literal["open", "closed"])


@dataclass(frozen=True)
class Job:
    """One execution: overrides of dore-execute, the scene, and where its report goes."""

    overrides: tuple[str, ...]
    scene: Scene
    folder: Path

    @property
    def done(self) -> bool:
        """Whether it came to its end."""
        return bool(read_record(self.folder / REPORT_NAME).get("finished"))


def main(options: Options) -> None:
    """Run what is not done yet."""
    claim(options)
    jobs = [job for obstacles in options.obstacles for job in jobs_of(options, obstacles)]
    todo = [job for job in jobs if not job.done]
    print(f"{len(jobs) - len(todo)} of {len(jobs)} executions are done in {options.out}")
    # Not forked: SAPIEN's renderer does not survive it.
    begin = _keep_rendering if options.loop == "closed" else None
    with multiprocessing.get_context("spawn").Pool(options.workers, initializer=begin) as pool:
        for _ in tqdm(pool.imap_unordered(_carry_out, todo), total=len(todo), unit="plan"):
            pass


def claim(options: Options) -> None:
    """Note what the runs are, for the page; a folder holds runs of one kind.

    Raises:
        InputError: the folder holds others.
    """
    kind = {name: getattr(options, name) for name in ("planner", "loop", "disturbance", "seed")}
    kind |= {"solved_by": ", ".join(options.solved_by), "overrides": ", ".join(options.overrides)}
    file = options.out / ARGUMENTS
    if (known := read_record(file)) not in ({}, kind):
        raise InputError(f"out: {options.out} holds executions of another kind ({known}), want another folder")
    options.out.mkdir(parents=True, exist_ok=True)
    write_record(file, kind)
    write_record(options.out / ABOUT_FILE, {"commit": commit()})


def jobs_of(options: Options, obstacles: int) -> list[Job]:
    """The executions of scenes with so many obstacles."""
    kinds = ["moved", "slip", "intruder"] if options.disturbance == "mixed" else [options.disturbance]
    plain = (f"planner={options.planner}", f"loop={options.loop}", *options.overrides)
    scenes = solvable_scenes(options.solved_by, obstacles, options.runs, 4 * options.runs, options.seed)
    return [
        Job(
            (f"disturbance={kinds[number % len(kinds)]}", f"seed={number}", *plain),
            scene,
            options.out / f"z{obstacles}" / f"{number:03d}",
        )
        for number, scene in enumerate(scenes)
    ]


def solvable_scenes(planners: list[str], obstacles: int, count: int, candidates: int, seed: int) -> list[Scene]:
    """The first `count` of so many scenes of the test split that all of the planners have a plan for.

    Raises:
        InputError: there are too few.
    """
    cfg = composed("execute", f"planner=[{','.join(planners)}]")
    reach = build.reach_of(cfg, "cpu")
    instances = InstanceSet.generate(reach, candidates, Difficulty(obstacles, obstacles), "test", seed)
    every = [planner.plan(instances.batch()) for planner in build.planners_of(cfg, reach)]
    solved = [all(plan.status is Status.SOLVED for plan in plans) for plans in zip(*every, strict=True)]
    rows = [row for row, by_all in enumerate(solved) if by_all][:count]
    if len(rows) < count:
        raise InputError(f"runs: {count}, but only {len(rows)} of {len(instances)} scenes are solved by all")
    print(f"{obstacles} obstacles: {count} of the first {rows[-1] + 1} scenes are solved by {', '.join(planners)}")
    problems = list(instances)
    return [problems[row].scene for row in rows]


def _keep_rendering() -> None:
    """One environment stays open in each process: without any, the next one compiles its shaders again, 10 s."""
    cfg = composed("execute")
    setup = setup_of(cfg, film=False)
    env = setup.environment(make(cfg.layout, "layout"), setup.bodies(1), render_backend())
    env.reset(options={"cells": [0]})
    RgbdCamera(env, seed=0).look()
    _KEPT.append(env)


def _carry_out(job: Job) -> None:
    """One execution, in a process of its own, on one thread."""
    torch.set_num_threads(1)
    cfg = composed("execute", *job.overrides)
    problem = Problem(job.scene, build.reach_of(cfg, "cpu", job.scene.layout))
    shutil.rmtree(job.folder, ignore_errors=True)
    loop = (closed_loop_of if cfg.loop == "closed" else open_loop_of)(cfg, problem)
    run_loop(loop, setup_of(cfg, film=False), job.folder)


if __name__ == "__main__":
    sys.exit(run(main, Options))
