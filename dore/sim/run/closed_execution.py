"""Runs a scene on the simulated arm in a closed loop, and reports."""

from __future__ import annotations

import time
from pathlib import Path

from dore.errors import InputError
from dore.sim.motion.rehearsal import Refused
from dore.sim.run.closed_loop import ClosedLoop, Loop
from dore.sim.run.disturbances import Disturbed
from dore.sim.run.film import Video
from dore.sim.run.open_loop import check_reach, conclude
from dore.sim.run.report import ExecutionReport
from dore.sim.run.setup import CONTROL_S, REPORT_NAME, VIDEO_NAME, Stage
from dore.sim.scene.agent import render_backend
from dore.world.plan import Scene


def execute_closed(scene: Scene, loop: Loop, stage: Stage, out_dir: Path) -> ExecutionReport:
    """See, plan, execute one move, see again; write `execution.json` (and `execution.mp4`) to `out_dir`.

    It ends with the target held up and the camera's word that it is out, or with a named refusal. The report is
    rewritten as things happen. `conditions` are the simulator's own word, of which the arm knows nothing.

    Args:
        scene: where the objects are put at the start; the arm is not told.
        loop, stage: what looks, plans, disturbs, moves.
        out_dir: made if it is not there.

    Raises:
        InputError: nothing can render here, so that nothing can be seen; the camera does not see every cell; no room
            for what the disturbance puts in.
        OSError: `out_dir` cannot be written.
    """
    if render_backend() == "none":
        raise InputError("loop: closed needs a camera, and no Vulkan driver is here; see scripts/install_lavapipe.sh")
    loop.eye.check_sees(scene.layout)
    room = scene.layout.n_cells - 1 - len(scene.obstacles)
    spare = loop.disturbance.spare_objects
    if spare > room:
        raise InputError(f"disturbance: puts in {spare} more, and the scene has {room} cells left")
    started = time.perf_counter()
    out_dir.mkdir(parents=True, exist_ok=True)
    bodies = stage.bodies(1 + len(scene.obstacles) + spare)
    report = stage.report(scene, bodies, loop.planner)
    report.pictures = VIDEO_NAME if stage.film else "not asked for"

    def save() -> None:
        report.write(out_dir / REPORT_NAME)

    save()
    try:
        check_reach(scene.layout, loop.reach, stage)
    except Refused as refusal:
        report.outcome, report.message, report.refused = refusal.outcome, f"refused: {refusal}", True
    else:
        bare = stage.environment(scene.layout, bodies, render_backend(), eye=loop.eye)
        env = Disturbed(bare, loop.disturbance)
        try:
            env.reset(seed=stage.seed, options=stage.placing(scene))
            with Video(env, out_dir / VIDEO_NAME, CONTROL_S, stage.film) as film:
                run = ClosedLoop(env, loop, stage.kinematics, report, save, film)
                run.run()
                conclude(run.operator, report)
                if report.claimed:
                    film.tell(report.message)
            report.stills = film.stills
            report.video = VIDEO_NAME if film.written else None
        finally:
            env.close()
    report.finished = True
    report.wall_s = round(time.perf_counter() - started, 3)
    save()
    return report
