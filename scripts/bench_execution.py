"""How fast plans are carried out: seconds and steps of each, where the time goes, and what a second core brings.

python -m scripts.bench_execution out=FOLDER [plans=20]
FOLDER/rows.csv has a row a plan and process, first of one process, then of two that begin together; `dore-report
study=execution_speed` makes the page. Open loop, without pictures, 3 x 6 with 7 obstacles, the environment kept as
dore-evaluate does; the start of a process and its first execution do not count.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial, wraps
from pathlib import Path
from typing import Any

import gymnasium as gym
import torch

from dore.app import build
from dore.app.execute import loop_of, plan_problem, setup_of
from dore.report.measurements import write_measurements
from dore.sim.kinematics import ArmKinematics
from dore.sim.motion.collision import CollisionChecker
from dore.sim.run.setup import CONTROL_S
from dore.sim.run.workcell import Workcell
from dore.world.generator import Difficulty
from dore.world.instances import InstanceSet
from dore.world.problem import Problem, Scene
from scripts.program import composed, run

PARTS: dict[str, tuple[Any, str]] = {
    "kinematics_s": (ArmKinematics, "line"),
    "collision_s": (CollisionChecker, "first_contact"),
    "simulation_s": (gym.Wrapper, "step"),
}
Rows = list[dict[str, Any]]


@dataclass(frozen=True)
class Options:
    """out: the folder of the rows. plans: scenes, each carried out once a process."""

    out: Path
    plans: int = 20


def main(options: Options) -> None:
    """Measure and write the rows."""
    load = f"{os.getloadavg()[0]:.2f}"
    reach = build.reach_of(composed("execute", "reach=panda_slim"), "cpu")
    instances = InstanceSet.generate(reach, options.plans, Difficulty(7, 7), "test", 11)
    scenes = [problem.scene for problem in instances]
    rows = [row for processes in (1, 2) for row in together(scenes, processes)]
    write_measurements(options.out, rows, load_before=load, control_s=CONTROL_S)


def together(scenes: list[Scene], processes: int) -> Rows:
    """The rows of some processes that begin together, each of which carries out all scenes."""
    context = multiprocessing.get_context("spawn")
    start = context.Barrier(processes)
    with context.Pool(processes, initializer=_begin, initargs=(start,)) as pool:
        each = pool.map(_carry_out, [scenes] * processes, chunksize=1)
    return [{"processes": processes, "process": place, **row} for place, rows in enumerate(each, 1) for row in rows]


def _begin(start: Any) -> None:
    globals()["_start"] = start


def _carry_out(scenes: list[Scene]) -> Rows:
    """All scenes, one after the other, once every process is ready."""
    torch.set_num_threads(1)
    parts = dict.fromkeys(PARTS, 0.0)
    for name, (owner, method) in PARTS.items():
        setattr(owner, method, _timed(getattr(owner, method), name, parts))
    cfg = composed("execute", "planner=exact")
    cell = Workcell(setup_of(cfg, film=False), scenes[0].layout)
    plan = partial(plan_problem, build.planner_of(cfg, cell.reach))
    loops = [loop_of(cfg, Problem(scene, cell.reach), "exact", plan) for scene in scenes]
    rows = []
    cell.carry_out(loops[0], seed=0)
    globals()["_start"].wait()
    for number, loop in enumerate(loops, 1):
        parts.update(dict.fromkeys(PARTS, 0.0))
        began = time.perf_counter()
        report = cell.carry_out(loop, seed=0)
        seconds, steps = time.perf_counter() - began, round(report.simulated_s / CONTROL_S)
        rows.append({"plan": number, "seconds": seconds, "steps": steps, **parts})
    cell.close()
    return rows


def _timed(method: Callable[..., Any], name: str, parts: dict[str, float]) -> Callable[..., Any]:
    """The method, its outermost calls' wall time added up."""
    inside = [0]

    @wraps(method)
    def timed(*given: Any, **named: Any) -> Any:
        if inside[0]:
            return method(*given, **named)
        inside[0], began = 1, time.perf_counter()
        try:
            return method(*given, **named)
        finally:
            inside[0] = 0
            parts[name] += time.perf_counter() - began

    return timed


if __name__ == "__main__":
    sys.exit(run(main, Options))
