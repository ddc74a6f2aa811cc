"""dore-evaluate arm=NAME: each planner plans each scene, and the simulated arm carries that out; a row of both."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import asdict
from importlib import import_module
from itertools import chain
from typing import Any, cast

import pandas as pd
from joblib import Parallel, delayed, parallel_config
from omegaconf import DictConfig, OmegaConf

from dore.app import build
from dore.app.execute import loop_of, plan_problem, setup_of
from dore.app.own_parts import current_folder_importable
from dore.configure import make, trust_command_line
from dore.errors import InputError, whole
from dore.planners.base import Planner
from dore.report.evaluation import check_done, row_of
from dore.report.progress import ProgressBar
from dore.report.rows import ExecutedRow, Timing
from dore.sim.motion.outcome import Outcome
from dore.sim.run.report import ExecutionReport
from dore.sim.run.workcell import Workcell
from dore.world.instances import InstanceSet
from dore.world.plan import Plan, Status
from dore.world.problem import Batch, Problem, Scene
from dore.world.reach import Reach

CHOICES = {"loop": ("open", "closed"), "backend": ("loky", "ray"), "timing": ("single",), "device": ("cpu",)}
WORST = ("placement_error_mm", "others_moved_mm", "tilt_deg")
_built: dict[str, SceneRuns] = {}
"""What this process plans with and carries out, by the config in YAML."""


class SceneRuns:
    """What a process plans with and carries out, built once from a composed config.

    Raises:
        InputError: what one of its parts refuses, or a layout out of the arm's reach.
    """

    def __init__(self, cfg: DictConfig) -> None:
        self.cfg = cfg
        self.cell = Workcell(setup_of(cfg, film=False), make(cfg.layout, "layout"))
        self.planners: dict[str, Planner] = {}

    def run(self, name: str, number: int, scene: Scene) -> ExecutedRow:
        """Plan and carry out scene `number`, counted from 1."""
        problem, plans = Problem(scene, self.cell.reach), []
        planner = self._planner(name, problem)

        def plan(seen: Problem) -> Plan:
            plans.append(plan_problem(planner, seen))
            return plans[-1]

        wall, cpu = time.perf_counter(), time.process_time()
        report = self.cell.carry_out(loop_of(self.cfg, problem, name, plan), self.cfg.seed + number)
        seconds = {"wall_s": time.perf_counter() - wall, "cpu_s": time.process_time() - cpu}
        return _row(name, number, problem, plans, report, self.cell.setup.arm.pushed_m, seconds)

    def _planner(self, name: str, problem: Problem) -> Planner:
        """A planner, which has planned once before it counts: compiling, first allocations."""
        if not self.planners:
            self.planners = {one.name: one for one in build.planners_of(self.cfg, self.cell.reach)}
            for one in self.planners.values():
                one.plan(Batch.of(problem))
        return self.planners[name]


def own_reach(cfg: DictConfig) -> dict[str, Any]:
    """The reach of a composed config's arm on its layout, as a config; checks what decides how plans are carried out.

    Raises:
        InputError: a value of theirs, or what `SceneRuns` raises.
    """
    whole("workers", cfg.workers, 1, at_most=256)
    for key, options in CHOICES.items():
        if cfg[key] not in options:
            raise InputError(f"{key}: got {cfg[key]!r}, want {' or '.join(options)} where an arm carries plans out")
    reach = SceneRuns(cfg).cell.reach
    return {"_target_": f"{Reach.__module__}.{Reach.__name__}", **reach.to_dict()}


def rows_of_scenes(
    cfg: DictConfig, planners: list[Planner], instances: InstanceSet, done: pd.DataFrame
) -> Iterator[ExecutedRow]:
    """The rows that are missing, scene by scene, as the workers have them; the last few are lost in a kill.

    Raises:
        InputError: rows that are from another evaluation, or a backend that is not installed.
    """
    names, problems, text = [one.name for one in planners], list(instances), OmegaConf.to_yaml(cfg, resolve=True)
    check_done(done, names, dict(enumerate(problems, 1)), Timing.SINGLE)
    there = set(zip(done.planner, done.instance, strict=True))
    jobs = [
        delayed(_run)(text, name, number, problem.scene)
        for number, problem in enumerate(problems, 1)
        for name in names
        if (name, number) not in there
    ]
    with ExitStack() as stack:
        stack.callback(_close)
        if cfg.workers > 1:
            _register(cfg.backend)
            stack.enter_context(parallel_config(cfg.backend))
        if cfg.workers > 1 and cfg.backend == "ray":  # Its backend for joblib returns lists alone.
            size = 8 * cfg.workers
            parts = (jobs[first : first + size] for first in range(0, len(jobs), size))
            made = chain.from_iterable(Parallel(n_jobs=cfg.workers, batch_size=1)(part) for part in parts)
        else:
            made = Parallel(n_jobs=cfg.workers, batch_size=1, return_as="generator")(jobs)
        with ProgressBar(total=len(names) * len(problems), initial=len(there), unit="run") as bar:
            for row in made:
                yield row
                bar.update()


def _register(backend: str) -> None:
    """Make a backend known to joblib."""
    if backend == "ray":
        try:
            import_module("ray.util.joblib").register_ray()
        except ModuleNotFoundError:
            raise InputError("backend: ray is not installed (pip install ray)") from None


def _run(config: str, planner: str, number: int, scene: Scene) -> ExecutedRow:
    """One row, in a worker's process."""
    return _runs(config).run(planner, number, scene)


def _runs(config: str) -> SceneRuns:
    """What this process has built for a config; what it had for another one is closed."""
    if config not in _built:
        _close()
        cfg = cast(DictConfig, OmegaConf.create(config))
        current_folder_importable()
        trust_command_line(cfg)
        build.use_threads(cfg.threads)
        _built[config] = SceneRuns(cfg)
    return _built[config]


def _close() -> None:
    for runs in _built.values():
        runs.cell.close()
    _built.clear()


def _row(
    planner: str, number: int, problem: Problem, plans: list[Plan], report: ExecutionReport, pushed_m: float,
    seconds: dict[str, Any],
) -> ExecutedRow:  # fmt: skip
    """What a plan and its execution come to; of a closed loop's plans the first counts, but for the seconds."""
    first = plans[0] if plans else Plan(Status.GAVE_UP, (), None, planner, 0.0, reason=report.message)
    plan: dict[str, Any] = asdict(row_of(planner, number, problem, first, Timing.SINGLE))
    plan["planning_s"] = sum(one.planning_s for one in plans)
    moves, events = pd.DataFrame([asdict(move) for move in report.moves]), pd.DataFrame(report.events)
    of_kind: dict[Any, list[str]] = events.groupby("event").text.agg(list).to_dict() if len(events) else {}
    worst: dict[str, Any] = {name: float(moves[name].max()) if len(moves) else None for name in WORST}
    return ExecutedRow(
        **plan,
        **seconds,
        **worst,
        outcome=report.outcome,
        success=report.success,
        claimed=report.claimed,
        refused=report.refused,
        moves_made=len(moves),
        faults=len(of_kind.get("fault", [])),
        plans=len(plans),
        disturbance="; ".join(of_kind.get("disturbance", [])),
        toppled=report.outcome is Outcome.TOPPLED or report.conditions.get("all_upright") is False,
        pushed=int((moves.others_moved_mm > 1e3 * pushed_m).sum()) if len(moves) else 0,
        grasp_margin_mm=float(moves.grasp_margin_mm.min()) if len(moves) else None,
        simulated_s=report.simulated_s,
        message=report.message,
    )
