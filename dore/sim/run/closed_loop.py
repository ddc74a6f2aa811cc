"""See, plan, move once, see again: an execution that goes by the camera and the fingers alone."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dore.draw.boards import Panel
from dore.errors import whole
from dore.sim.config import Body
from dore.sim.motion.collision import TABLE_OVERHANG_M, CollisionChecker, Standing
from dore.sim.motion.kinematics import ArmKinematics
from dore.sim.motion.outcome import Outcome
from dore.sim.motion.rehearsal import MoveTask, Refused, Rehearsal, tasks_of
from dore.sim.run.disturbances import Disturbance
from dore.sim.run.feedback import Touch
from dore.sim.run.film import Video
from dore.sim.run.measure import MoveMeter
from dore.sim.run.operator import Operator
from dore.sim.run.report import ExecutionReport
from dore.sim.run.setup import CONTROL_S
from dore.sim.scene.task import DoreTabletopEnv
from dore.sim.vision.camera import Eye
from dore.sim.vision.camera_config import EyeConfig
from dore.sim.vision.scene_estimate import NotUnderstood
from dore.sim.vision.seen import Seen, after_move, confirm, panel_of, same_board
from dore.world.plan import Plan, Status
from dore.world.problem import Problem, Scene, cell_id
from dore.world.reach import Reach


@dataclass(frozen=True)
class Limits:
    """When to give up. max_moves: pick-and-places; max_faults: moves that went wrong; max_looks: looks at a scene
    that the camera does not understand.

    Raises:
        InputError: below 1, or below 0 for the faults.
    """

    max_moves: int
    max_faults: int
    max_looks: int

    def __post_init__(self) -> None:
        whole("limits.max_moves", self.max_moves, 1)
        whole("limits.max_faults", self.max_faults, 0)
        whole("limits.max_looks", self.max_looks, 1)


@dataclass(frozen=True)
class Loop:
    """What closes the loop.

    planner: its name. plan: its plan for a scene. reach: what it plans with, and what the arm can do.
    """

    planner: str
    plan: Callable[[Scene], Plan]
    reach: Reach
    eye: EyeConfig
    disturbance: Disturbance
    limits: Limits


class ClosedLoop:
    """One execution. What it goes by is the camera, the fingers and the arm's own joints; the simulator's state is
    asked for the report's figures only.

    Args:
        env: after a reset.
        loop: what looks, plans and disturbs.
        kinematics: the arm.
        report: filled in as things happen; `save` is called after each.
        film: shown and told what happens.
    """

    def __init__(
        self, env: Any, loop: Loop, kinematics: ArmKinematics, report: ExecutionReport, save: Callable[[], None],
        film: Video,
    ) -> None:  # fmt: skip
        self._env, self._loop, self._kinematics = env, loop, kinematics
        self._world: DoreTabletopEnv = env.unwrapped
        self._report, self._save, self._film = report, save, film
        self._eye, self._rng = Eye(loop.eye, report.seed), np.random.default_rng(report.seed)
        self._moves = self._faults = self._most_seen = 0
        self._touch = Touch(self._world)
        self.operator = Operator(env, self._rehearsal(()), self._touch, film.after_step)

    def run(self) -> None:
        """Until the target is out, or something makes it give up; the report says which."""
        plan: Plan | None = None
        expected: Scene | None = None
        try:
            while True:
                self._disturb()
                seen = self._look()
                if plan is None or not same_board(seen.scene, expected):
                    plan = self._plan(seen)
                tasks = tasks_of(seen.scene, plan, self._moves + 1)
                self._rehearse(seen, tasks)
                went_well = self._carry_out(seen, tasks[0])
                if went_well and not plan.moves:
                    self._confirm(seen.scene)
                    return
                expected = after_move(seen.scene, plan.moves[0]) if went_well else None
                plan = replace(plan, moves=plan.moves[1:])
        except Refused as refusal:
            moved = bool(self._report.moves)
            self._report.outcome, self._report.refused = refusal.outcome, not moved
            self._report.message = f"{'stopped' if moved else 'refused'}: {refusal}"
            self._note("refusal", str(refusal))

    def _disturb(self) -> None:
        done = self._loop.disturbance.between_moves(self._world, self._moves, self._rng)
        if done:
            self.operator.hold(5)
            self._note("disturbance", done)

    def _look(self) -> Seen:
        """What the camera sees; it looks again where it does not understand, or misses an object.

        Raises:
            Refused: NOT_UNDERSTOOD, MISSING.
        """
        outcome, why = Outcome.NOT_UNDERSTOOD, ""
        for _ in range(self._loop.limits.max_looks):
            try:
                seen = Seen.of(self._eye.look(self._env), self._world.layout)
            except NotUnderstood as error:
                outcome, why = Outcome.NOT_UNDERSTOOD, error.reason
                self._note("look", why)
                continue
            self._note("look", seen.words, seen.scene)
            if len(seen.objects) >= self._most_seen:
                self._most_seen = len(seen.objects)
                return seen
            outcome, why = Outcome.MISSING, f"{self._most_seen} objects were seen, and now {len(seen.objects)}"
        raise Refused(outcome, "the camera", why)

    def _plan(self, seen: Seen) -> Plan:
        """The moves for what is seen.

        Raises:
            Refused: NO_PLAN.
        """
        plan = self._loop.plan(seen.scene)
        if plan.status is not Status.SOLVED:
            raise Refused(Outcome.NO_PLAN, plan.planner, f"{plan.status} ({plan.reason})")
        moves = [f"{cell_id(move.pick)} to {cell_id(move.place)}" for move in plan.moves]
        self._note("plan", ", ".join([*moves, "the target"]))
        return plan

    def _rehearse(self, seen: Seen, tasks: tuple[MoveTask, ...]) -> None:
        """The rest of the plan in kinematics; then a rehearsal that stands where the arm does.

        Raises:
            Refused: the plan cannot be carried out.
        """
        began = time.perf_counter()
        self._begin(seen).play(tasks)
        self.operator.rehearsal = self._begin(seen)
        self._report.rehearsal_s = round((self._report.rehearsal_s or 0.0) + time.perf_counter() - began, 3)

    def _begin(self, seen: Seen) -> Rehearsal:
        """Every object where, and as wide as, it is seen."""
        rehearsal = self._rehearsal(seen.bodies)
        rehearsal.begin(seen.scene)
        rehearsal.standing.update({body: Standing(one.xy, one.yaw_rad) for body, one in enumerate(seen.objects)})
        return rehearsal

    def _rehearsal(self, bodies: tuple[Body, ...]) -> Rehearsal:
        layout = self._world.layout
        checker = CollisionChecker(self._kinematics, bodies, layout.front_m - TABLE_OVERHANG_M)
        return Rehearsal(layout, self._kinematics, checker, CONTROL_S)

    def _carry_out(self, seen: Seen, task: MoveTask) -> bool:
        """One move, and the way back; whether, for all that the hand can feel, it went well.

        Raises:
            Refused: out of moves or faults; or what the rehearsal just allowed cannot be done, and the arm stays.
        """
        if self._moves >= self._loop.limits.max_moves:
            raise Refused(Outcome.GAVE_UP, task.name, f"{self._moves} moves are made, limits.max_moves")
        self._moves += 1
        panel = panel_of(seen.scene, self._loop.reach, task, self._moves)
        self._film.show(f"move {self._moves}: {panel.words}" if panel.move else panel.words, panel)
        operator, meter = self.operator, MoveMeter(self._world, self.operator.simulated_s)
        outcome, aimed = operator.run(task), seen.objects[task.body].xy
        self._report.moves.append(meter.read(task, meter.nearest(aimed), outcome, operator.simulated_s, aimed))
        still = f"move_{self._moves}" if panel.move else "target"
        if outcome is Outcome.DONE:
            self._film.tell(f"{panel.words}: done", still=still)
        else:
            self._note("fault", f"{task.name}: {outcome}", still=still)
            self._faults += 1
            operator.recover()
        if outcome is not Outcome.DONE or task.place_cell is not None:
            operator.park()
        self._report.simulated_s = round(operator.simulated_s, 3)
        self._save()
        if self._faults > self._loop.limits.max_faults:
            raise Refused(Outcome.GAVE_UP, task.name, f"{self._faults} faults, limits.max_faults")
        return outcome is Outcome.DONE

    def _confirm(self, before: Scene) -> None:
        """Claim success only if the hand holds something, and the camera sees the rest of the board, but no target.

        Raises:
            Refused: UNCONFIRMED.
        """
        self.operator.hold(20)
        try:
            confirm(self._eye.look(self._env), before)
        except NotUnderstood as error:
            raise Refused(Outcome.UNCONFIRMED, "the camera", error.reason) from None
        if not self._touch.holding():
            raise Refused(Outcome.UNCONFIRMED, "the hand", "it holds nothing")
        self._note("look", "the target is out, and every obstacle stands where it stood")
        self._report.claimed, self._report.outcome = True, Outcome.DONE

    def _note(self, kind: str, text: str, scene: Scene | None = None, still: str | None = None) -> None:
        """Into the report, and the film: beside the picture the scene, where one was seen."""
        self._report.events.append({"simulated_s": round(self.operator.simulated_s, 3), "event": kind, "text": text})
        self._save()
        self._film.tell(
            f"{kind}: {text}", Panel(Problem(scene, self._loop.reach)) if scene is not None else None, still
        )
