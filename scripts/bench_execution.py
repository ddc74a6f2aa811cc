"""How fast plans are carried out: steps per second, seconds a plan, where the time goes, and what a second core brings.

python -m scripts.bench_execution [--plans 20] [--out docs/results/execution_speed.md]
Open loop, without pictures, 3 x 6 with 7 obstacles; one torch thread a process.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import time
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import gymnasium as gym
import torch

from dore.app import build
from dore.app.execute import setup_of
from dore.files import atomic_write, commit
from dore.report.page import markdown
from dore.sim.motion.collision import CollisionChecker
from dore.sim.motion.kinematics import ArmKinematics
from dore.sim.run.execution import execute
from dore.sim.run.open_loop import OpenLoop
from dore.sim.run.setup import CONTROL_S
from dore.world.plan import PlanFile
from dore.world.problem import Batch, Problem, Scene
from scripts.executions import composed, solvable_scenes

PARTS: dict[str, tuple[Any, str]] = {
    "inverse kinematics": (ArmKinematics, "line"),
    "collision checks": (CollisionChecker, "first_contact"),
    "simulation and the task's conditions": (gym.Wrapper, "step"),
}


class Timing(NamedTuple):
    """One process's plans."""

    seconds: list[float]
    """Wall seconds of each."""
    steps: int
    parts: dict[str, float]
    """Wall seconds of all plans together, by part."""


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plans", type=int, default=20, help="scenes, each carried out once a process")
    parser.add_argument("--out", type=Path, help="the page")
    chosen = parser.parse_args()
    load = os.getloadavg()[0]
    scenes = solvable_scenes(["exact"], 7, chosen.plans, 4 * chosen.plans, 11)
    alone = _together(scenes, processes=1)
    both = _together(scenes, processes=2)
    (one,) = alone[1]
    total, plans = sum(one.seconds), len(scenes)
    shares = [["part", "share of the time (%)", "ms a plan"]]
    shares += [[name, f"{100 * s / total:.1f}", f"{1000 * s / plans:.0f}"] for name, s in one.parts.items()]
    rest = total - sum(one.parts.values())
    shares.append(["the rest (set-up, report)", f"{100 * rest / total:.1f}", f"{1000 * rest / plans:.0f}"])
    simulating = one.parts["simulation and the task's conditions"]
    speeds = [
        ["processes", "plans", "plans/s", "wall s a plan, median", "ratio"],
        ["1", str(plans), f"{plans / alone[0]:.2f}", f"{median(one.seconds):.2f}", "1"],
        ["2", str(2 * plans), f"{2 * plans / both[0]:.2f}",
         f"{median([s for timing in both[1] for s in timing.seconds]):.2f}", f"{2 * alone[0] / both[0]:.2f}"],
    ]  # fmt: skip
    lines = [
        "# Speed of executions", "",
        f"`python -m scripts.bench_execution --plans {chosen.plans}`, commit {commit()}, {os.cpu_count()} cores, "
        f"load {load:.2f} at the start. 3 x 6, 7 obstacles, open loop, no pictures; the start of a process is not "
        "counted.", "",
        f"{one.steps / simulating:.0f} simulated control steps a second ({CONTROL_S * one.steps / simulating:.0f} "
        f"simulated seconds a second), {one.steps / plans:.0f} steps a plan.", "",
        markdown(speeds), "", markdown(shares),
    ]  # fmt: skip
    print("\n".join(lines))
    if chosen.out:
        with atomic_write(chosen.out) as file:
            file.write("\n".join(lines) + "\n")


def _together(scenes: list[Scene], processes: int) -> tuple[float, list[Timing]]:
    """Wall seconds of the plans of the slowest of some processes, which begin together, and each one's own times."""
    context = multiprocessing.get_context("spawn")
    start = context.Barrier(processes)
    with context.Pool(processes, initializer=_begin, initargs=(start,)) as pool:
        timings = pool.map(_carry_out, [scenes] * processes, chunksize=1)
    return max(sum(timing.seconds) for timing in timings), timings


def _begin(start: Any) -> None:
    globals()["_start"] = start


def _carry_out(scenes: list[Scene]) -> Timing:
    """All scenes, one after the other, once every process is ready."""
    torch.set_num_threads(1)
    parts, steps = dict.fromkeys(PARTS, 0.0), 0
    for name, (owner, method) in PARTS.items():
        setattr(owner, method, _timed(getattr(owner, method), name, parts))
    cfg = composed(("planner=exact",))
    setup = setup_of(cfg, film=False)
    reach = build.reach_of(cfg, "cpu")
    planner, seconds = build.planner_of(cfg, reach), []
    plans = [
        PlanFile(problem, planner.plan(Batch.of(problem))[0]) for problem in (Problem(scene, reach) for scene in scenes)
    ]
    with TemporaryDirectory() as folder:
        execute(OpenLoop(plans[0]), setup, Path(folder))
        parts.update(dict.fromkeys(PARTS, 0.0))
        globals()["_start"].wait()
        for plan_file in plans:
            began = time.perf_counter()
            report = execute(OpenLoop(plan_file), setup, Path(folder))
            seconds.append(time.perf_counter() - began)
            steps += round(report.simulated_s / CONTROL_S)
    return Timing(seconds, steps, parts)


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
    main()
