"""Runs a plan file on the simulated arm: rehearse, refuse or execute, report."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from dore.errors import InputError
from dore.plan import PlanFile, Status, cell_id
from dore.sim.arm import render_backend
from dore.sim.collision import TABLE_OVERHANG_M, CollisionChecker, Standing
from dore.sim.config import ArmConfig, Body, CameraConfig, ObjectConfig
from dore.sim.description import arm_files
from dore.sim.kinematics import ArmKinematics, Unreachable
from dore.sim.motion import Operator
from dore.sim.outcome import Outcome
from dore.sim.rehearsal import Refused, Rehearsal, RehearsedMove
from dore.sim.report import ExecutionReport, MoveReport
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
        InputError: a plan that is not solved.
        OSError: `out_dir` cannot be written.
    """
    if plan_file.plan.status is not Status.SOLVED:
        raise InputError(f"plan.status: {plan_file.plan.status}, want solved: there is nothing to execute")
    started = time.perf_counter()
    out_dir.mkdir(parents=True, exist_ok=True)
    objects = objects or ObjectConfig()
    bodies = objects.draw(1 + len(plan_file.scene.obstacles), np.random.default_rng(seed))
    report = _blank(plan_file, arm, bodies, seed)
    try:
        moves = rehearse(plan_file, arm, bodies)
    except Refused as refusal:
        report.outcome, report.message, report.refused = refusal.outcome, f"refused: {refusal}", True
    else:
        report.rehearsal_s = round(time.perf_counter() - started, 3)
        _perform(plan_file, arm, objects, camera or CameraConfig(), bodies, moves, report, out_dir, video)
    report.finished = True
    report.wall_s = round(time.perf_counter() - started, 3)
    report.write(out_dir / REPORT_NAME)
    return report


def rehearse(plan_file: PlanFile, arm: ArmConfig, bodies: tuple[Body, ...]) -> tuple[RehearsedMove, ...]:
    """The plan as joint commands, checked against reach and collisions; the bodies stand in their cells' centres.

    bodies: the target first, then one for each obstacle of the scene.

    Raises:
        Refused: naming the move, the reason and what is in the way.
    """
    scene, layout = plan_file.scene, plan_file.scene.layout
    kinematics = ArmKinematics(arm_files(visuals=False), arm)
    checker = CollisionChecker(kinematics, bodies, layout.front_m - TABLE_OVERHANG_M)
    standing = {i: Standing(layout.cells[cell]) for i, cell in enumerate((scene.target, *scene.obstacles))}
    try:
        rehearsal = Rehearsal(layout, kinematics, checker, bodies, standing, _CONTROL_S)
    except Unreachable as error:
        raise Refused(Outcome.OUT_OF_REACH, "start", str(error)) from None
    return rehearsal.play(scene, plan_file.plan)


def _blank(plan_file: PlanFile, arm: ArmConfig, bodies: tuple[Body, ...], seed: int) -> ExecutionReport:
    cells = (plan_file.scene.target, *plan_file.scene.obstacles)
    listed = [{"cell": cell_id(c), "target": i == 0, **asdict(bodies[i])} for i, c in enumerate(cells)]
    return ExecutionReport(Outcome.INCOMPLETE, "not finished", arm.name, seed, plan_file.plan.planner, listed)


def _perform(
    plan_file: PlanFile, arm: ArmConfig, objects: ObjectConfig, camera: CameraConfig, bodies: tuple[Body, ...],
    moves: tuple[RehearsedMove, ...], report: ExecutionReport, out_dir: Path, video: bool,
) -> None:  # fmt: skip
    backend = render_backend() if video else "none"
    report.pictures = "not asked for" if not video else NO_PICTURES if backend == "none" else VIDEO_NAME
    env = gym.make(
        "DoreTabletop-v1", layout=plan_file.scene.layout, bodies=bodies, arm=arm, camera=camera,
        density_kg_m3=objects.density_kg_m3, obs_mode="none", reward_mode="none", control_mode="pd_joint_pos",
        sim_backend="physx_cpu", render_backend=backend, enable_shadow=camera.shadows,
        render_mode=None if backend == "none" else "rgb_array",
    )  # fmt: skip
    try:
        report.write(out_dir / REPORT_NAME)  # an interrupted execution leaves a report that says so
        env.reset(seed=report.seed, options={"cells": [plan_file.scene.target, *plan_file.scene.obstacles]})
        with _video(env, out_dir, camera, backend != "none") as film:
            operator = Operator(env, film.after_step)
            _run_moves(operator, plan_file, moves, report, out_dir)
            operator.hold(_LAST_LOOK_STEPS)
            _conclude(operator, report)
        report.video = VIDEO_NAME if film.written else None
    finally:
        env.close()


def _video(env: Any, out_dir: Path, camera: CameraConfig, on: bool) -> Video:
    return Video(env, out_dir / VIDEO_NAME, camera.frames_per_s, camera.playback_speed, _CONTROL_S, on)


def _run_moves(
    operator: Operator, plan_file: PlanFile, moves: tuple[RehearsedMove, ...], report: ExecutionReport, out_dir: Path
) -> None:
    report.outcome = Outcome.DONE
    for move in moves:
        report.moves.append(_timed_move(operator, plan_file, move))
        report.outcome = report.moves[-1].outcome
        report.message = f"{move.name}: {report.outcome}"
        report.simulated_s = round(operator.simulated_s, 3)
        report.write(out_dir / REPORT_NAME)
        if report.outcome is not Outcome.DONE:
            return


def _timed_move(operator: Operator, plan_file: PlanFile, move: RehearsedMove) -> MoveReport:
    wall, simulated, before = time.perf_counter(), operator.simulated_s, operator.positions()
    outcome = operator.run(move)
    after, error = operator.positions(), None
    if move.place_cell is not None:
        goal = plan_file.scene.layout.cells[move.place_cell]
        error = round(1e3 * float(np.linalg.norm(after[move.body, :2] - goal)), 2)
    others = np.delete(np.linalg.norm(after - before, axis=1), move.body)
    return MoveReport(
        name=move.name,
        pick=cell_id(move.pick_cell),
        place=None if move.place_cell is None else cell_id(move.place_cell),
        outcome=outcome,
        placement_error_mm=error,
        others_moved_mm=round(1e3 * float(others.max(initial=0.0)), 2),
        tilt_deg=round(float(operator.leaning_deg()[move.body]), 2),
        simulated_s=round(operator.simulated_s - simulated, 3),
        wall_s=round(time.perf_counter() - wall, 3),
    )


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
