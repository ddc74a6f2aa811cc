"""What dore-execute does with a composed config; returns the exit code."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from omegaconf import DictConfig

from dore.app import build, run_folder, scenes
from dore.configure import make
from dore.errors import ExitCode, InputError, path_of, seed_of, whole
from dore.planners.base import Planner
from dore.sim.run.closed_loop import ClosedLoop
from dore.sim.run.execution import Loop, run_loop
from dore.sim.run.open_loop import OpenLoop
from dore.sim.run.report import ExecutionReport
from dore.sim.run.setup import REPORT_NAME, Setup
from dore.world.files import read_plan
from dore.world.generator import Difficulty
from dore.world.instances import random_problem
from dore.world.plan import Plan, PlanFile, Status
from dore.world.problem import Batch, Problem


def execute_command(cfg: DictConfig) -> int:
    """Carry out a plan file, or plan a scene and carry that out, in an open or a closed loop.

    0: done; 1: a fault was seen on the way; 3: refused before anything moved.
    """
    for key, options in (("video", ("auto", "off")), ("loop", ("open", "closed"))):
        if cfg[key] not in options:
            raise InputError(f"{key}: got {cfg[key]!r}, want {' or '.join(options)}")
    if (cfg.plan is None) == (cfg.scene is None):
        raise InputError("plan, scene: want one of them: a plan file, or a scene file or random")
    build.use_threads(cfg.threads)
    setup = setup_of(cfg, film=cfg.video == "auto")
    loop = (_closed if cfg.loop == "closed" else _open)(cfg)
    with run_folder.claimed(run_folder.folder_of(cfg), keep_if=(REPORT_NAME,)) as folder:
        report = run_loop(loop, setup, folder)
    _print_report(report, folder)
    if report.refused:
        return ExitCode.REFUSED
    return ExitCode.OK if report.success else ExitCode.FAILED


def setup_of(cfg: DictConfig, film: bool) -> Setup:
    """Arm, objects, camera and viewpoint of a composed config."""
    arm, objects, view, camera = (make(cfg[name], name) for name in ("arm", "objects", "view", "camera"))
    return Setup(arm, objects, view, camera, seed_of("seed", cfg.seed), film, cfg.jitter_m, cfg.turned)


def closed_loop_of(cfg: DictConfig, problem: Problem) -> ClosedLoop:
    """The closed loop of a composed config."""
    planner = build.planner_of(cfg, problem.reach)
    disturbance, limits = (make(cfg[name], name) for name in ("disturbance", "limits"))
    return ClosedLoop(problem, planner.name, partial(plan_problem, planner), disturbance, limits)


def open_loop_of(cfg: DictConfig, problem: Problem) -> OpenLoop:
    """The open loop of a composed config, with its planner's plan."""
    planner = build.planner_of(cfg, problem.reach)
    return OpenLoop(PlanFile(problem, plan_problem(planner, problem)))


def plan_problem(planner: Planner, problem: Problem) -> Plan:
    """A planner's plan for one problem."""
    return planner.plan(Batch.of(problem))[0]


def _open(cfg: DictConfig) -> Loop:
    """A plan as it is, or one for the scene."""
    for name in ("disturbance", "limits"):
        make(cfg[name], name)  # Of a closed loop alone; what is wrong with them is said in any case.
    if cfg.plan is None:
        return open_loop_of(cfg, _problem(cfg))
    plan_file = read_plan(path_of("plan", cfg.plan))
    if plan_file.plan.status is not Status.SOLVED:
        raise InputError(f"plan.status: {plan_file.plan.status}, want solved: there is nothing to execute")
    return OpenLoop(plan_file)


def _closed(cfg: DictConfig) -> Loop:
    """The scene, which the arm has to see for itself."""
    if cfg.scene is None:
        raise InputError("loop: closed plans for what it sees; want scene= and not plan=")
    return closed_loop_of(cfg, _problem(cfg))


def _problem(cfg: DictConfig) -> Problem:
    """The scene, and the reach on its layout."""
    if cfg.scene != "random":
        scene = scenes.given(cfg).scene
        return Problem(scene, build.reach_of(cfg, "cpu", scene.layout))
    scenes.check_random(cfg)
    reach, obstacles = build.reach_of(cfg, "cpu"), whole("obstacles", cfg.obstacles, 1)
    if obstacles >= reach.n_cells:
        raise InputError(f"obstacles: got {obstacles}, want at most {reach.n_cells - 1}, one cell less than there are")
    return random_problem(reach, Difficulty(obstacles, obstacles), cfg.seed)


def _print_report(report: ExecutionReport, folder: Path) -> None:
    for event in report.events:
        print(f"  {event['simulated_s']:6.1f} s  {event['event']}: {event['text']}")
    for move in report.moves:
        error = "" if move.placement_error_mm is None else f"placed within {move.placement_error_mm:.1f} mm, "
        print(
            f"  {move.name}: {move.outcome}, {error}others moved {move.others_moved_mm:.1f} mm at most, "
            f"{move.simulated_s:.1f} simulated s"
        )
    print(report.message)
    if report.pictures not in ("", report.video):
        print(report.pictures)
    made = ", ".join([REPORT_NAME, *([report.video] if report.video else []), *report.stills])
    print(f"in {folder}: {made}")
