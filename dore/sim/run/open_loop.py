"""A plan as it is: the whole of it rehearsed, then carried out move by move while nothing goes wrong."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial

import numpy as np

from dore.draw.boards import panels_of
from dore.sim.config import Body
from dore.sim.motion.outcome import Outcome, Refused
from dore.sim.motion.rehearsal import Rehearsal, WorldState, tasks_of
from dore.sim.run.disturbances import Disturbance, Nothing, check_room
from dore.sim.run.execution import Execution, Run
from dore.sim.run.feedback import PrivilegedState
from dore.sim.run.operator import HOLD_UP_STEPS
from dore.sim.run.setup import CONTROL_S, Setup
from dore.sim.scene.task import DoreTabletopEnv
from dore.world.plan import PlanFile, Status
from dore.world.problem import Problem


@dataclass(frozen=True)
class OpenLoop:
    """Carries out a plan file; a fault ends the execution at the move in which it was seen.

    plan_file: problem and plan; cells count from 0. disturbance: it goes on with the plan all the same, until it sees a
    fault.
    """

    plan_file: PlanFile
    disturbance: Disturbance = field(default_factory=Nothing)
    needs_renderer = False

    @property
    def problem(self) -> Problem:
        """The plan's."""
        return self.plan_file.problem

    @property
    def planner(self) -> str:
        """Who made the plan."""
        return self.plan_file.plan.planner

    def check(self, setup: Setup) -> None:
        """Whether there is room for what the disturbance puts in.

        Raises:
            InputError: too few cells are left.
        """
        check_room(self.disturbance, self.problem.scene)

    def feedback(self, world: DoreTabletopEnv) -> PrivilegedState:
        """The simulator's state."""
        return PrivilegedState(world)

    def begin(self, setup: Setup, bodies: tuple[Body, ...]) -> Run:
        """The whole plan in kinematics: every motion within reach, and nothing touched.

        Raises:
            Refused: not a solved plan; or naming the move, the reason and what is in the way.
        """
        plan = self.plan_file.plan
        if plan.status is not Status.SOLVED:
            raise Refused(Outcome.NO_PLAN, plan.planner, f"{plan.status} ({plan.reason})")
        scene = self.problem.scene
        rehearsal = Rehearsal(scene.layout, setup.kinematics, bodies, CONTROL_S)
        start = rehearsal.start(scene)
        rehearsal.play(start, tasks_of(scene, plan))
        return partial(self._run, rehearsal, start, np.random.default_rng(setup.seed))

    def _run(self, rehearsal: Rehearsal, state: WorldState, rng: np.random.Generator, execution: Execution) -> None:
        """Run the moves until one does not end well."""
        report, plan = execution.report, self.plan_file.plan
        tasks = tasks_of(self.problem.scene, plan)
        for number, (task, panel) in enumerate(zip(tasks, panels_of(self.problem, plan), strict=True)):
            execution.disturb(self.disturbance, number, rng)
            caption = panel.words if panel.move is None else f"move {panel.number} of {len(tasks) - 1}: {panel.words}"
            outcome, state = execution.move(rehearsal, state, task, panel, caption)
            if outcome is not Outcome.DONE:
                report.outcome, report.message = outcome, f"{task.name}: {outcome}"
                return
        execution.operator.hold(HOLD_UP_STEPS)
        report.claimed, report.outcome = True, Outcome.DONE
