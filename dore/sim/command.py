"""What dore-execute does with a composed config; returns the exit code."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from omegaconf import DictConfig

from dore import build, run_folder
from dore.errors import InputError, path_of, seed_of
from dore.instances import InstanceSet, random_scene
from dore.plan import Plan, PlanFile, Scene, Status
from dore.plan_files import read_plan, read_scene
from dore.reach import Reach
from dore.sampling import Difficulty
from dore.sim.closed_execution import execute_closed
from dore.sim.closed_loop import Loop
from dore.sim.execute import execute as execute_plan
from dore.sim.report import ExecutionReport
from dore.sim.stage import REPORT_NAME, Stage

OK, FAULT, REFUSED = 0, 1, 3


def execute(cfg: DictConfig) -> int:
    """Carry out a plan file, or plan a scene and carry that out, in an open or a closed loop.

    0: done; 1: a fault was seen on the way; 3: refused before anything moved.
    """
    for key, options in (("video", ("auto", "off")), ("loop", ("open", "closed"))):
        if cfg[key] not in options:
            raise InputError(f"{key}: got {cfg[key]!r}, want {' or '.join(options)}")
    if (cfg.plan is None) == (cfg.scene is None):
        raise InputError("plan, scene: want one of them: a plan file, or a scene file or random")
    build.use_threads(cfg.threads)
    arm, camera, objects = (build.make(cfg[name], name) for name in ("arm", "camera", "objects"))
    stage = Stage(arm, objects, camera, seed_of("seed", cfg.seed), cfg.video == "auto")
    work = (_closed if cfg.loop == "closed" else _open)(cfg, stage)
    with run_folder.claimed(cfg.run_dir, worth=REPORT_NAME) as folder:
        report = work(folder)
    _print_report(report, folder)
    if report.refused:
        return REFUSED
    return OK if report.success else FAULT


Work = Callable[[Path], ExecutionReport]


def _open(cfg: DictConfig, stage: Stage) -> Work:
    """A plan as it is, or one for the scene."""
    if cfg.plan is not None:
        plan_file = read_plan(path_of("plan", cfg.plan))
    else:
        scene, reach, plan_scene = _problem(cfg)
        plan = plan_scene(scene)
        if plan.status is not Status.SOLVED:
            raise InputError(f"scene: {plan.planner} has no plan for it: {plan.status} ({plan.reason})")
        plan_file = PlanFile(scene, reach, plan)
    return partial(execute_plan, plan_file, stage)


def _closed(cfg: DictConfig, stage: Stage) -> Work:
    """The scene, which the arm has to see for itself."""
    if cfg.scene is None:
        raise InputError("loop: closed plans for what it sees; want scene= and not plan=")
    scene, reach, plan = _problem(cfg)
    eye, disturbance, limits = (build.make(cfg[name], name) for name in ("eye", "disturbance", "limits"))
    return partial(
        execute_closed, scene, Loop(str(next(iter(cfg.planners))), plan, reach, eye, disturbance, limits), stage
    )


def _problem(cfg: DictConfig) -> tuple[Scene, Reach, Callable[[Scene], Plan]]:
    """The scene, and what plans it, or another one of its layout, with which reach."""
    if cfg.scene == "random":
        reach = build.reach_of(cfg, "cpu")
        difficulty = Difficulty(cfg.obstacles, cfg.obstacles)
        difficulty.check_fits(reach.n_cells)
        scene = random_scene(reach, difficulty, cfg.seed)
    else:
        scene = read_scene(path_of("scene", cfg.scene))
        reach = build.reach_of(cfg, "cpu", scene.layout)
    planner = build.planner_of(cfg, reach)
    return scene, reach, lambda seen: planner.plan(InstanceSet.of_scene(reach, seen))[0]


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
    if report.pictures != report.video:
        print(report.pictures)
    made = [REPORT_NAME, *([report.video] if report.video else [])]
    print(f"{' and '.join(made)} {'is' if len(made) == 1 else 'are'} in {folder}")
