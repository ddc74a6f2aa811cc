"""Runs a plan file on the simulated arm: rehearse, refuse or execute, report."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from dore.draw.boards import panels_of
from dore.sim.config import Body
from dore.sim.motion.arm_reach import arm_reach, cells_out_of_reach, lane_differences
from dore.sim.motion.collision import TABLE_OVERHANG_M, CollisionChecker
from dore.sim.motion.outcome import Outcome
from dore.sim.motion.rehearsal import MoveTask, Refused, Rehearsal, tasks_of
from dore.sim.run.feedback import Truth
from dore.sim.run.film import Video
from dore.sim.run.measure import MoveMeter
from dore.sim.run.operator import Operator
from dore.sim.run.report import ExecutionReport
from dore.sim.run.setup import CONTROL_S, REPORT_NAME, VIDEO_NAME, Stage
from dore.sim.scene.task import DoreTabletopEnv
from dore.world.layout import Layout
from dore.world.plan import PlanFile, Status, cell_id
from dore.world.reach import Reach

_LAST_LOOK_STEPS = 20


def execute(plan_file: PlanFile, stage: Stage, out_dir: Path) -> ExecutionReport:
    """Carry out a plan in `DoreTabletop-v1` and write `execution.json` (and `execution.mp4`) to `out_dir`.

    The whole plan is rehearsed in kinematics first; a plan that the arm cannot carry out is refused, and nothing
    moves; so is a plan that solves nothing. A fault ends the execution at the move in which it was seen. The report is
    rewritten after each move.

    Args:
        plan_file: scene and plan; cells count from 0.
        stage: arm, objects, camera, seed.
        out_dir: made if it is not there.

    Raises:
        OSError: `out_dir` cannot be written.
    """
    started = time.perf_counter()
    out_dir.mkdir(parents=True, exist_ok=True)
    plan, bodies = plan_file.plan, stage.bodies(1 + len(plan_file.scene.obstacles))
    report = stage.report(plan_file.scene, bodies, plan.planner)
    try:
        if plan.status is not Status.SOLVED:
            raise Refused(Outcome.NO_PLAN, plan.planner, f"{plan.status} ({plan.reason})")
        check_reach(plan_file.scene.layout, plan_file.reach, stage)
        rehearsal = rehearse(plan_file, stage, bodies)
    except Refused as refusal:
        report.outcome, report.message, report.refused = refusal.outcome, f"refused: {refusal}", True
    else:
        report.rehearsal_s = round(time.perf_counter() - started, 3)
        rehearsal.begin(plan_file.scene)
        backend, report.pictures = stage.pictures()
        env = stage.environment(plan_file.scene.layout, bodies, backend)
        try:
            env.reset(seed=stage.seed, options=stage.placing(plan_file.scene))
            _perform(env, rehearsal, plan_file, report, out_dir)
        finally:
            env.close()
    report.finished = True
    report.wall_s = round(time.perf_counter() - started, 3)
    report.write(out_dir / REPORT_NAME)
    return report


def check_reach(layout: Layout, planned: Reach, stage: Stage) -> None:
    """Whether plans are made for what this arm can do.

    Raises:
        Refused: the arm cannot reach cells of the layout, or the plan is for another reach: which cells, or lanes.
    """
    kinematics = stage.kinematics
    own = arm_reach(stage.arm, stage.objects, layout, kinematics)
    far = cells_out_of_reach(layout, own, kinematics)
    if far:
        listed = ", ".join(str(cell_id(cell)) for cell in far)
        raise Refused(Outcome.OUT_OF_REACH, "the layout", f"cells {listed} are out of the arm's reach")
    differences = lane_differences(planned, own)
    if differences:
        raise Refused(Outcome.OTHER_REACH, "the plan", f"made for another reach: {differences}")


def rehearse(plan_file: PlanFile, stage: Stage, bodies: tuple[Body, ...]) -> Rehearsal:
    """The whole plan in kinematics: every motion within reach, and nothing touched.

    bodies: the target first, then one for each obstacle of the scene; they stand in their cells' centres.

    Returns:
        The rehearsal after the last move.

    Raises:
        Refused: naming the move, the reason and what is in the way.
    """
    scene, layout, kinematics = plan_file.scene, plan_file.scene.layout, stage.kinematics
    checker = CollisionChecker(kinematics, bodies, layout.front_m - TABLE_OVERHANG_M)
    rehearsal = Rehearsal(layout, kinematics, checker, CONTROL_S)
    rehearsal.begin(scene)
    rehearsal.play(tasks_of(scene, plan_file.plan))
    return rehearsal


def _perform(env: Any, rehearsal: Rehearsal, plan_file: PlanFile, report: ExecutionReport, out_dir: Path) -> None:
    """Run the moves until one does not end well; the report is rewritten after each."""
    report.write(out_dir / REPORT_NAME)  # an interrupted execution leaves a report that says so
    with Video(env, out_dir / VIDEO_NAME, CONTROL_S, report.pictures == VIDEO_NAME) as film:
        world: DoreTabletopEnv = env.unwrapped
        operator = Operator(env, rehearsal, Truth(world, rehearsal), film.after_step)
        outcome = Outcome.DONE
        tasks = tasks_of(plan_file.scene, plan_file.plan)
        for task, panel in zip(tasks, panels_of(plan_file.problem, plan_file.plan), strict=True):
            moving = panel.move is not None
            film.show(f"move {panel.number} of {len(tasks) - 1}: {panel.words}" if moving else panel.words, panel)
            outcome = _run_move(operator, task, MoveMeter(world, operator.simulated_s), report)
            film.tell(report.message, still=f"move_{panel.number}" if moving else "target")
            report.stills = film.stills
            report.write(out_dir / REPORT_NAME)
            if outcome is not Outcome.DONE:
                break
        report.outcome = outcome
        operator.hold(_LAST_LOOK_STEPS)
        conclude(operator, report)
        if len(report.moves) == len(tasks):
            film.tell(report.message)
    report.video = VIDEO_NAME if film.written else None


def _run_move(operator: Operator, task: MoveTask, meter: MoveMeter, report: ExecutionReport) -> Outcome:
    try:
        outcome = operator.run(task)
        report.message = f"{task.name}: {outcome}"
    except Refused as refusal:
        outcome, report.message = refusal.outcome, f"stopped: {refusal}"
    report.moves.append(meter.read(task, task.body, outcome, operator.simulated_s, aimed_xy=None))
    report.simulated_s = round(operator.simulated_s, 3)
    return outcome


def conclude(operator: Operator, report: ExecutionReport) -> None:
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
