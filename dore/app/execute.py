"""What dore-execute does with a composed config; returns the exit code."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from omegaconf import DictConfig

from dore.app import build, jobs, run_folder, scenes
from dore.configure import make
from dore.errors import ExitCode, InputError, path_of, seed_of, whole
from dore.files import shipped_or
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

    0: done; 1: a fault occurred; 3: refused before anything moved.
    """
    if cfg.video not in ("auto", "off"):
        raise InputError(f"video: got {cfg.video!r}, want auto or off")
    build.use_threads(cfg.threads)
    setup = setup_of(cfg, film=cfg.video == "auto")
    loop = _of_scene(cfg, setup) if cfg.plan is None else _of_plan(cfg)
    if jobs.in_sweep():
        run_folder.clear(jobs.folder_of_job(), _of_execution)
    with run_folder.claimed(run_folder.folder_of(cfg), keep_if=(REPORT_NAME,), resumes=False) as folder:
        report = run_loop(loop, setup, folder)
    _print_report(report, folder)
    if report.refused:
        return ExitCode.REFUSED
    return ExitCode.OK if report.success else ExitCode.FAILED


def _of_execution(path: Path) -> bool:
    """Whether an execution writes such a file, one that was stopped or killed among them."""
    return path.name == REPORT_NAME or path.suffix in (".tmp", ".png", ".mp4")


def setup_of(cfg: DictConfig, film: bool) -> Setup:
    """Arm, objects, camera and viewpoint of a composed config."""
    arm, objects, view, camera = (make(cfg[name], name) for name in ("arm", "objects", "view", "camera"))
    return Setup(arm, objects, view, camera, seed_of("seed", cfg.seed), film, cfg.jitter_m, cfg.turned)


def loop_of(cfg: DictConfig, problem: Problem, planner: str, plan: Callable[[Problem], Plan]) -> Loop:
    """The loop of a composed config: an open one with the problem's plan, or a closed one.

    planner: the name of what plans.

    Raises:
        InputError: no such loop, or what disturbance or limits refuse.
    """
    if cfg.loop not in ("open", "closed"):
        raise InputError(f"loop: got {cfg.loop!r}, want open or closed")
    disturbance, limits = (make(cfg[name], name) for name in ("disturbance", "limits"))
    if cfg.loop == "closed":
        return ClosedLoop(problem, planner, plan, disturbance, limits)
    return OpenLoop(PlanFile(problem, plan(problem)), disturbance)


def plan_problem(planner: Planner, problem: Problem) -> Plan:
    """A planner's plan for one problem."""
    return planner.plan(Batch.of(problem))[0]


def _of_plan(cfg: DictConfig) -> Loop:
    """A plan as it is."""
    if cfg.loop == "closed":
        raise InputError("loop: closed plans for what it sees; want scene= and not plan=")
    plan_file = read_plan(shipped_or(path_of("plan", cfg.plan), "plans"))
    if plan_file.plan.status is not Status.SOLVED:
        raise InputError(f"plan.status: {plan_file.plan.status}, want solved: there is nothing to execute")
    return loop_of(cfg, plan_file.problem, plan_file.plan.planner, lambda _: plan_file.plan)


def _of_scene(cfg: DictConfig, setup: Setup) -> Loop:
    """A scene with a planner's plan, or one that the arm has to see for itself."""
    problem = _problem(cfg, setup)
    planner = build.planner_of(cfg, problem.reach)
    return loop_of(cfg, problem, planner.name, partial(plan_problem, planner))


def _problem(cfg: DictConfig, setup: Setup) -> Problem:
    """The scene, and on its layout the arm's reach, or the one that is given."""
    given = scenes.given(cfg).scene if cfg.scene != "random" else None
    layout = given.layout if given else make(cfg.layout, "layout")
    reach = setup.reach(layout) if cfg.get("reach") is None else build.reach_of(cfg, "cpu", layout)
    if given:
        return Problem(given, reach)
    scenes.check_random(cfg)
    obstacles = whole("obstacles", cfg.obstacles, 1)
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
