"""One execution from start to report: the skeleton that the open and the closed loop share."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import AbstractContextManager, closing
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from dore.draw.boards import Panel
from dore.sim.config import Body
from dore.sim.motion.arm_reach import cells_out_of_reach, corridor_differences
from dore.sim.motion.outcome import Outcome, Refused
from dore.sim.motion.rehearsal import MoveTask, Rehearsal, WorldState
from dore.sim.run.disturbances import Disturbance, Disturbed
from dore.sim.run.feedback import Feedback
from dore.sim.run.film import Film
from dore.sim.run.operator import Operator
from dore.sim.run.report import ExecutionReport, MoveMeter
from dore.sim.run.setup import CONTROL_S, REPORT_NAME, VIDEO_NAME, Setup
from dore.sim.scene.task import DoreTabletopEnv
from dore.world.problem import Problem, cell_id
from dore.world.reach import Reach

_AFTER_DISTURBANCE_STEPS = 5


class Execution:
    """A running execution: the operator in its environment, and the report and film of what happens.

    Args:
        env: after a reset.
        feedback: what the operator knows of the world, made from the environment.
        report: filled in as things happen; `save` is called after each.
        film: shows what happens.
    """

    def __init__(
        self, env: Any, feedback: Callable[[DoreTabletopEnv], Feedback], report: ExecutionReport,
        save: Callable[[], None], film: Film,
    ) -> None:  # fmt: skip
        self.env, self.report, self.film, self._save = env, report, film, save
        self.world: DoreTabletopEnv = env.unwrapped
        self.operator = Operator(env, feedback(self.world), film.after_step)

    def move(
        self, rehearsal: Rehearsal, state: WorldState, task: MoveTask, panel: Panel, caption: str,
        aimed_xy: tuple[float, float] | None = None,
    ) -> tuple[Outcome, WorldState]:  # fmt: skip
        """Carry out one move, and report it; the state after it.

        caption, panel: what the film shows meanwhile.
        aimed_xy: where the hand expects the object, metres: the nearest one is reported. None: the task's.

        Raises:
            Refused: the rest of the move cannot be carried out; the arm stays where it is, and the move is reported.
        """
        operator, report, refusal = self.operator, self.report, None
        self.film.caption(caption, panel)
        meter = MoveMeter(self.world, operator.simulated_s)
        try:
            outcome, state = operator.run(rehearsal, state, task)
        except Refused as error:
            outcome, refusal = error.outcome, error
        body = task.body if aimed_xy is None else meter.nearest(aimed_xy)
        report.moves.append(meter.read(task, body, outcome, operator.simulated_s, aimed_xy))
        report.simulated_s = round(operator.simulated_s, 3)
        if refusal is not None:
            raise refusal
        still = "target" if panel.move is None else f"move_{panel.number}"
        if outcome is Outcome.DONE:
            self.film.pause(f"{task.name}: done", still=still)
            self._save()
        else:
            self.note("fault", f"{task.name}: {outcome}", still=still)
        return outcome, state

    def note(self, kind: str, text: str, panel: Panel | None = None, still: str | None = None) -> None:
        """Put an event into the report and the film. panel: the board to show beside the picture from now on."""
        self.report.events.append({"simulated_s": round(self.operator.simulated_s, 3), "event": kind, "text": text})
        self._save()
        self.film.pause(f"{kind}: {text}", panel, still)

    def disturb(self, disturbance: Disturbance, moves: int, rng: np.random.Generator) -> None:
        """Let a disturbance act between two moves, `moves` moves after the start."""
        done = disturbance.between_moves(self.world, moves, rng)
        if done:
            self.operator.hold(_AFTER_DISTURBANCE_STEPS)
            self.note("disturbance", done)

    def conclude(self) -> None:
        """Call nothing done that the task's own conditions do not confirm."""
        report = self.report
        report.conditions = self.operator.conditions()
        report.simulated_s = round(self.operator.simulated_s, 3)
        if report.outcome is not Outcome.DONE:
            return
        moves = len(report.moves) - 1
        report.message = (
            f"done: {moves} move{'s' * (moves != 1)}, then the target, in {report.simulated_s:g} simulated s"
        )
        if not report.conditions["success"]:
            unmet = ", ".join(name for name, met in report.conditions.items() if not met and name != "success")
            report.outcome, report.message = Outcome.INCOMPLETE, f"every motion ended well, but not met: {unmet}"
        self.film.pause(report.message)


Run = Callable[[Execution], None]
"""Carries a loop out. Sets the report's `outcome`, and its `message` where that is not DONE; or raises `Refused`."""


class Loop(Protocol):
    """What is carried out, and how. `problem`: what stands where, and the reach that plans are made with."""

    @property
    def problem(self) -> Problem: ...
    @property
    def planner(self) -> str: ...
    @property
    def disturbance(self) -> Disturbance: ...
    @property
    def needs_renderer(self) -> bool: ...

    def check(self, setup: Setup) -> None:
        """Raises InputError where the loop cannot begin with this setup."""

    def feedback(self, world: DoreTabletopEnv) -> Feedback:
        """What the operator knows while it moves."""

    def begin(self, setup: Setup, bodies: tuple[Body, ...]) -> Run:
        """Rehearse what is known before anything moves.

        Raises:
            Refused: it cannot be carried out.
        """


def run_loop(loop: Loop, setup: Setup, out_dir: Path) -> ExecutionReport:
    """Carry out a loop in `DoreTabletop-v1`, and write `execution.json` (and `execution.mp4`) to `out_dir`.

    What the arm cannot do is refused before anything moves. The report is rewritten as things happen; its `conditions`
    are the ground truth. `out_dir` is made if it is not there.

    Raises:
        InputError: the loop cannot begin with this setup.
        OSError: `out_dir` cannot be written.
    """
    loop.check(setup)
    out_dir.mkdir(parents=True, exist_ok=True)

    def environment(bodies: tuple[Body, ...], backend: str) -> AbstractContextManager[Any]:
        return closing(setup.environment(loop.problem.scene.layout, bodies, backend))

    return conduct(loop, setup, environment, out_dir)


Environments = Callable[[tuple[Body, ...], str], AbstractContextManager[Any]]
"""A `DoreTabletop-v1` for objects and a render backend; it may have held others before, until its reset."""


def conduct(
    loop: Loop, setup: Setup, environment: Environments, out_dir: Path | None, reach_known: bool = False
) -> ExecutionReport:
    """`run_loop` in an environment of the caller's.

    out_dir: where the report and the film go; None: nowhere. reach_known: plans are made with the arm's own reach.
    """
    started = time.perf_counter()
    bodies = setup.bodies(1 + len(loop.problem.scene.obstacles) + loop.disturbance.spare_objects)
    report = setup.report(loop.problem.scene, bodies, loop.planner)

    def save() -> None:
        if out_dir is not None:
            report.write(out_dir / REPORT_NAME)

    save()  # an interrupted execution leaves a report that says so
    try:
        if not reach_known:
            check_reach(loop.problem.reach, setup)
        run = loop.begin(setup, bodies)
    except Refused as refusal:
        _refuse(report, refusal)
    else:
        report.rehearsal_s = round(time.perf_counter() - started, 3)
        backend, report.pictures = setup.rendering(loop.needs_renderer)
        with environment(bodies, backend) as env:
            _perform(loop, run, setup, Disturbed(env, loop.disturbance), bodies, report, save, out_dir)
    report.finished = True
    report.wall_s = round(time.perf_counter() - started, 3)
    save()
    return report


def _perform(
    loop: Loop, run: Run, setup: Setup, env: Any, bodies: tuple[Body, ...], report: ExecutionReport,
    save: Callable[[], None], out_dir: Path | None,
) -> None:  # fmt: skip
    env.reset(seed=setup.seed, options={**setup.placing(loop.problem.scene), "bodies": bodies})
    with Film(env, (out_dir or Path()) / VIDEO_NAME, CONTROL_S, report.pictures == VIDEO_NAME) as film:
        report.stills = film.stills
        execution = Execution(env, loop.feedback, report, save, film)
        try:
            run(execution)
        except Refused as refusal:
            _refuse(report, refusal)
            execution.note("refusal", str(refusal))
        execution.conclude()
    report.video = VIDEO_NAME if film.written else None


def _refuse(report: ExecutionReport, refusal: Refused) -> None:
    report.outcome, report.refused = refusal.outcome, not report.moves
    report.message = f"{'refused' if report.refused else 'stopped'}: {refusal}"


def check_reach(planned: Reach, setup: Setup) -> None:
    """Whether plans are made for what this arm can do.

    Raises:
        Refused: the arm cannot reach cells of the layout, or the plan is for another reach: which cells, or corridors.
    """
    layout, kinematics = planned.layout, setup.kinematics
    own = setup.reach(layout)
    far = cells_out_of_reach(layout, own, kinematics)
    if far:
        listed = ", ".join(str(cell_id(cell)) for cell in far)
        raise Refused(Outcome.OUT_OF_REACH, "the layout", f"cells {listed} are out of the arm's reach")
    differences = corridor_differences(planned, own)
    if differences:
        raise Refused(Outcome.OTHER_REACH, "the plan", f"made for another reach: {differences}")
