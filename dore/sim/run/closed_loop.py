"""See, plan, move once, see again: a loop that knows only what the camera sees and the gripper senses."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dore.draw.boards import Panel
from dore.errors import InputError, whole
from dore.sim.config import Body
from dore.sim.motion.collision import Standing
from dore.sim.motion.outcome import Outcome, Refused
from dore.sim.motion.rehearsal import MoveTask, Rehearsal, WorldState, tasks_of
from dore.sim.run.disturbances import Disturbance, check_room
from dore.sim.run.execution import Execution, Run
from dore.sim.run.feedback import GripperFeedback
from dore.sim.run.operator import HOLD_UP_STEPS
from dore.sim.run.setup import CONTROL_S, Setup
from dore.sim.scene.agent import NO_DRIVER, render_backend
from dore.sim.scene.task import DoreTabletopEnv
from dore.sim.vision.camera import RgbdCamera, Sensor
from dore.sim.vision.scene_estimate import NotUnderstood, SceneEstimate, estimate, unconfirmed
from dore.world.plan import Move, Plan, Status
from dore.world.problem import Problem, Scene, cell_id


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
        whole("limits.max_moves", self.max_moves, 1, at_most=1000)
        whole("limits.max_faults", self.max_faults, 0)
        whole("limits.max_looks", self.max_looks, 1, at_most=100)


@dataclass(frozen=True)
class ClosedLoop:
    """Sees, plans, executes one move, and sees again. It ends when the target is held up and the camera confirms that
    it is out, or with a named refusal.

    problem: where the objects are put at the start, which the arm does not know, and the reach to plan with.
    planner: its name. plan: its plan for what is seen. sensor: what it sees with.
    """

    problem: Problem
    planner: str
    plan: Callable[[Problem], Plan]
    disturbance: Disturbance
    limits: Limits
    sensor: type[Sensor] = RgbdCamera

    @property
    def needs_renderer(self) -> bool:
        """Whether the sensor takes pictures."""
        return self.sensor.needs_renderer

    def check(self, setup: Setup) -> None:
        """Whether everything can be seen, and there is room for what the disturbance puts in.

        Raises:
            InputError: nothing can render here; the camera does not see every cell; too few cells are left.
        """
        if self.needs_renderer and render_backend() == "none":
            raise InputError(f"loop: closed needs a camera: {NO_DRIVER}")
        setup.camera.check_sees(self.problem.scene.layout)
        check_room(self.disturbance, self.problem.scene)

    def feedback(self, world: DoreTabletopEnv) -> GripperFeedback:
        """The fingers."""
        return GripperFeedback(world)

    def begin(self, setup: Setup, bodies: tuple[Body, ...]) -> Run:
        """Nothing is known beforehand."""
        return lambda execution: _ClosedRun(self, setup, execution).run()


class _ClosedRun:
    """One execution of a closed loop; the simulator's state is asked for the report's figures only."""

    def __init__(self, loop: ClosedLoop, setup: Setup, execution: Execution) -> None:
        self._loop, self._kinematics, self._execution = loop, setup.kinematics, execution
        self._sensor = loop.sensor(execution.env, setup.seed)
        self._rng = np.random.default_rng(setup.seed)
        self._layout, self._reach = loop.problem.scene.layout, loop.problem.reach
        self._moves = self._faults = self._most_seen = 0
        execution.report.rehearsal_s = 0.0

    def run(self) -> None:
        """Until the target is out.

        Raises:
            Refused: something makes it give up.
        """
        plan: Plan | None = None
        expected: tuple[int, set[int]] | None = None
        while True:
            self._execution.disturb(self._loop.disturbance, self._moves, self._rng)
            seen = self._look()
            if plan is None or (seen.scene.target, set(seen.scene.obstacles)) != expected:
                plan = self._plan(seen)
            rehearsal, state, task = self._rehearse(seen, plan)
            move = plan.moves[0] if plan.moves else None
            went_well = self._carry_out(rehearsal, state, task, self._panel(seen.scene, plan, move))
            if went_well and move is None:
                self._confirm(seen.scene)
                return
            expected = None
            if went_well and move is not None:
                expected = seen.scene.target, set(seen.scene.obstacles) - {move.pick} | {move.place}
            plan = replace(plan, moves=plan.moves[1:], optimal_moves=None)

    def _look(self) -> SceneEstimate:
        """What the camera sees; it looks again if it does not understand, or misses an object.

        Raises:
            Refused: NOT_UNDERSTOOD, MISSING.
        """
        outcome, why = Outcome.NOT_UNDERSTOOD, ""
        for _ in range(self._loop.limits.max_looks):
            try:
                seen = estimate(self._sensor.look(), self._layout)
            except NotUnderstood as error:
                outcome, why = Outcome.NOT_UNDERSTOOD, error.reason
                self._execution.note("look", why)
                continue
            self._execution.note("look", str(seen), Panel(Problem(seen.scene, self._reach)))
            if len(seen.objects) >= self._most_seen:
                self._most_seen = len(seen.objects)
                return seen
            outcome, why = Outcome.MISSING, f"{self._most_seen} objects were seen, and now {len(seen.objects)}"
        raise Refused(outcome, "the camera", why)

    def _plan(self, seen: SceneEstimate) -> Plan:
        """The moves for what is seen.

        Raises:
            Refused: NO_PLAN.
        """
        plan = self._loop.plan(Problem(seen.scene, self._reach))
        if plan.status is not Status.SOLVED:
            raise Refused(Outcome.NO_PLAN, plan.planner, f"{plan.status} ({plan.reason})")
        moves = [f"{cell_id(move.pick)} to {cell_id(move.place)}" for move in plan.moves]
        self._execution.note("plan", ", ".join([*moves, "the target"]))
        return plan

    def _rehearse(self, seen: SceneEstimate, plan: Plan) -> tuple[Rehearsal, WorldState, MoveTask]:
        """The rest of the plan in kinematics, every object where, and as wide as, it is seen; its next move.

        Raises:
            Refused: the plan cannot be carried out.
        """
        began, tasks = time.perf_counter(), tasks_of(seen.scene, plan, self._moves + 1)
        rehearsal = Rehearsal(self._layout, self._kinematics, seen.bodies, CONTROL_S)
        standing = {body: Standing(one.xy, one.yaw_rad) for body, one in enumerate(seen.objects)}
        state = rehearsal.start(seen.scene, standing)
        rehearsal.play(state, tasks)
        report = self._execution.report
        report.rehearsal_s = round((report.rehearsal_s or 0.0) + time.perf_counter() - began, 3)
        return rehearsal, state, tasks[0]

    def _panel(self, scene: Scene, plan: Plan, move: Move | None) -> Panel:
        direction = plan.target_direction_deg if move is None else None
        return Panel(Problem(scene, self._reach), move, direction, self._moves + 1)

    def _carry_out(self, rehearsal: Rehearsal, state: WorldState, task: MoveTask, panel: Panel) -> bool:
        """One move, and the way back; whether, as far as the hand can feel, it went well.

        Raises:
            Refused: out of moves or faults; or what the rehearsal just allowed cannot be done, and the arm stays.
        """
        limits, execution = self._loop.limits, self._execution
        if self._moves >= limits.max_moves:
            raise Refused(Outcome.GAVE_UP, task.name, f"{self._moves} moves are made, limits.max_moves")
        self._moves += 1
        caption = panel.words if panel.move is None else f"move {self._moves}: {panel.words}"
        outcome, state = execution.move(rehearsal, state, task, panel, caption, state.standing[task.body].xy)
        if outcome is not Outcome.DONE:
            self._faults += 1
            execution.operator.recover()
        if outcome is not Outcome.DONE or task.place_cell is not None:
            execution.operator.park(rehearsal, state)
        if self._faults > limits.max_faults:
            raise Refused(Outcome.GAVE_UP, task.name, f"{self._faults} faults, limits.max_faults")
        return outcome is Outcome.DONE

    def _confirm(self, before: Scene) -> None:
        """Claim success only if the hand holds something, and the camera sees the rest of the board, but no target.

        Raises:
            Refused: UNCONFIRMED.
        """
        execution = self._execution
        execution.operator.hold(HOLD_UP_STEPS)
        try:
            why = unconfirmed(self._sensor.look(), before)
        except NotUnderstood as error:
            why = error.reason
        if why:
            raise Refused(Outcome.UNCONFIRMED, "the camera", why)
        if not GripperFeedback(execution.world).holding():
            raise Refused(Outcome.UNCONFIRMED, "the hand", "it holds nothing")
        execution.note("look", "the target is out, and every obstacle stands where it stood")
        execution.report.claimed, execution.report.outcome = True, Outcome.DONE
