"""Runs a plan file on the simulated arm: rehearse, refuse or execute, report."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from dore.errors import InputError
from dore.plan import PlanFile, Status, cell_id
from dore.sim.arm import render_backend
from dore.sim.collision import TABLE_OVERHANG_M, CollisionChecker
from dore.sim.config import ArmConfig, Body, CameraConfig, ObjectConfig, preset
from dore.sim.description import arm_files
from dore.sim.kinematics import ArmKinematics
from dore.sim.measure import MoveMeter
from dore.sim.motion import Operator
from dore.sim.outcome import Outcome
from dore.sim.rehearsal import MoveTask, Refused, Rehearsal, tasks_of
from dore.sim.report import ExecutionReport
from dore.sim.senses import Truth
from dore.sim.task import DoreTabletopEnv
from dore.sim.video import Video

REPORT_NAME, VIDEO_NAME = "execution.json", "execution.mp4"
NO_PICTURES = "no Vulkan driver here: state only; for pictures run scripts/install_lavapipe.sh (Debian 12, as root)"
_CONTROL_S = 0.05
_LAST_LOOK_STEPS = 20


def execute(
    plan_file: PlanFile,
    arm: ArmConfig,
    out_dir: Path,
    video: bool,
    *,
    objects: ObjectConfig | None = None,
    camera: CameraConfig | None = None,
    seed: int = 0,
) -> ExecutionReport:
    """Carry out a solved plan in `DoreTabletop-v1` and write `execution.json` (and `execution.mp4`) to `out_dir`.

    The whole plan is rehearsed in kinematics first; a plan that the arm cannot carry out is refused, and nothing
    moves. A fault ends the execution at the move in which it was seen. The report is rewritten after each move.

    Args:
        plan_file: scene and plan; cells count from 0.
        arm: how the arm stands and moves.
        out_dir: made if it is not there.
        video: whether to make pictures where a Vulkan driver exists.
        objects: what the objects are; None: the defaults.
        camera: None: the default.
        seed: of the objects' shapes and of the simulator; the same seed gives the same report but for wall times.

    Raises:
        InputError: a plan that is not solved, or objects lower than the grasp.
        OSError: `out_dir` cannot be written.
    """
    if plan_file.plan.status is not Status.SOLVED:
        raise InputError(f"plan.status: {plan_file.plan.status}, want solved: there is nothing to execute")
    objects = objects or preset("objects/mixed")
    if objects.height_m[0] <= arm.grasp_height_m:
        raise InputError(
            f"objects.height_m: from {objects.height_m[0]:g}, want more than arm.grasp_height_m {arm.grasp_height_m:g}"
        )
    started = time.perf_counter()
    out_dir.mkdir(parents=True, exist_ok=True)
    bodies = objects.draw(1 + len(plan_file.scene.obstacles), np.random.default_rng(seed))
    report = _blank(plan_file, arm, bodies, seed)
    tasks = tasks_of(plan_file.scene, plan_file.plan)
    try:
        rehearsal = rehearse(plan_file, arm, bodies)
    except Refused as refusal:
        report.outcome, report.message, report.refused = refusal.outcome, f"refused: {refusal}", True
    else:
        report.rehearsal_s = round(time.perf_counter() - started, 3)
        rehearsal.begin(plan_file.scene)
        backend = render_backend() if video else "none"
        report.pictures = "not asked for" if not video else NO_PICTURES if backend == "none" else VIDEO_NAME
        env = _environment(plan_file, arm, bodies, objects, camera or preset("camera/corner"), backend)
        try:
            _perform(env, rehearsal, plan_file, tasks, report, out_dir)
        finally:
            env.close()
    report.finished = True
    report.wall_s = round(time.perf_counter() - started, 3)
    report.write(out_dir / REPORT_NAME)
    return report


def rehearse(plan_file: PlanFile, arm: ArmConfig, bodies: tuple[Body, ...]) -> Rehearsal:
    """The whole plan in kinematics: every motion within reach, and nothing touched.

    bodies: the target first, then one for each obstacle of the scene; they stand in their cells' centres.

    Returns:
        The rehearsal after the last move.

    Raises:
        Refused: naming the move, the reason and what is in the way.
    """
    scene, layout = plan_file.scene, plan_file.scene.layout
    kinematics = ArmKinematics(arm_files(visuals=False), arm)
    checker = CollisionChecker(kinematics, bodies, layout.front_m - TABLE_OVERHANG_M)
    rehearsal = Rehearsal(layout, kinematics, checker, _CONTROL_S)
    rehearsal.begin(scene)
    rehearsal.play(tasks_of(scene, plan_file.plan))
    return rehearsal


def _blank(plan_file: PlanFile, arm: ArmConfig, bodies: tuple[Body, ...], seed: int) -> ExecutionReport:
    cells = (plan_file.scene.target, *plan_file.scene.obstacles)
    listed = [{"cell": cell_id(c), "target": i == 0, **asdict(bodies[i])} for i, c in enumerate(cells)]
    return ExecutionReport(Outcome.INCOMPLETE, "not finished", arm.name, seed, plan_file.plan.planner, listed)


def _environment(
    plan_file: PlanFile, arm: ArmConfig, bodies: tuple[Body, ...], objects: ObjectConfig, camera: CameraConfig,
    backend: str,
) -> Any:  # fmt: skip
    return gym.make(
        "DoreTabletop-v1", layout=plan_file.scene.layout, bodies=bodies, arm=arm, camera=camera,
        density_kg_m3=objects.density_kg_m3, obs_mode="none", reward_mode="none", control_mode="pd_joint_pos",
        sim_backend="physx_cpu", render_backend=backend, enable_shadow=camera.shadows,
        render_mode=None if backend == "none" else "rgb_array",
    )  # fmt: skip


def _perform(
    env: Any, rehearsal: Rehearsal, plan_file: PlanFile, tasks: Sequence[MoveTask], report: ExecutionReport,
    out_dir: Path,
) -> None:  # fmt: skip
    """Run the moves until one does not end well; the report is rewritten after each."""
    report.write(out_dir / REPORT_NAME)  # an interrupted execution leaves a report that says so
    env.reset(seed=report.seed, options={"cells": [plan_file.scene.target, *plan_file.scene.obstacles]})
    with Video(env, out_dir / VIDEO_NAME, _CONTROL_S, report.pictures == VIDEO_NAME) as film:
        world: DoreTabletopEnv = env.unwrapped
        operator = Operator(env, rehearsal, Truth(world, rehearsal), film.after_step)
        report.outcome = Outcome.DONE
        for task in tasks:
            _run_move(operator, task, MoveMeter(world, operator.simulated_s), report)
            report.write(out_dir / REPORT_NAME)
            if report.outcome is not Outcome.DONE:
                break
        operator.hold(_LAST_LOOK_STEPS)
        _conclude(operator, report)
    report.video = VIDEO_NAME if film.written else None


def _run_move(operator: Operator, task: MoveTask, meter: MoveMeter, report: ExecutionReport) -> None:
    try:
        report.outcome = operator.run(task)
        report.message = f"{task.name}: {report.outcome}"
    except Refused as refusal:
        report.outcome, report.message = refusal.outcome, f"stopped: {refusal}"
    report.moves.append(meter.read(task, task.body, report.outcome, operator.simulated_s))
    report.simulated_s = round(operator.simulated_s, 3)


def _conclude(operator: Operator, report: ExecutionReport) -> None:
    """Nothing is called done that the task's own conditions do not confirm."""
    report.conditions = operator.conditions()
    report.simulated_s = round(operator.simulated_s, 3)
    if report.outcome is not Outcome.DONE:
        return
    if report.conditions["success"]:
        report.message = f"done: {len(report.moves) - 1} moves, then the target, in {report.simulated_s:g} simulated s"
        return
    unmet = ", ".join(name for name, met in report.conditions.items() if not met and name != "success")
    report.outcome, report.message = Outcome.INCOMPLETE, f"every motion ended well, but not met: {unmet}"
