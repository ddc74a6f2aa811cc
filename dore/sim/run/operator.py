"""Drives the arm through rehearsed motions, and reports how each of them ended."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from dore.sim.frames import Array
from dore.sim.motion.outcome import Outcome
from dore.sim.motion.rehearsal import MoveTask, Rehearsal, WorldState
from dore.sim.run.feedback import Feedback
from dore.sim.scene.agent import CLOSE_HAND, OPEN_HAND
from dore.sim.scene.task import DoreTabletopEnv

HOLD_UP_STEPS = 20
"""So long the target is held up at the end, control steps."""
_SETTLE_STEPS = 4
_GRIP_STEPS = 10
_RELEASE_STEPS = 8


class Operator:
    """The arm in a running environment.

    Args:
        env: a `DoreTabletop-v1` made with `control_mode="pd_joint_pos"`, as gymnasium returns it, after a reset.
        feedback: what the operator knows of the world.
        after_step: called after every control step (the film's camera).
    """

    def __init__(self, env: Any, feedback: Feedback, after_step: Callable[[], None]) -> None:
        self._env, self._feedback, self._after_step = env, feedback, after_step
        self._task: DoreTabletopEnv = env.unwrapped
        self._gripper = OPEN_HAND
        self.joints: Array = self._task.agent.arm_joints()[0].double().cpu().numpy()
        self._way_out: list[Array] = []
        """Commands that take the hand out of the grid after a fault in it."""
        self.steps = 0

    @property
    def simulated_s(self) -> float:
        """Simulated seconds since the start."""
        return self.steps / self._task.control_freq

    def conditions(self) -> dict[str, bool]:
        """The task's named conditions and `success`."""
        return {name: bool(value[0]) for name, value in self._task.evaluate().items()}

    def hold(self, steps: int) -> None:
        """Stay where the arm is for some control steps."""
        for _ in range(steps):
            self._command(self.joints)

    def run(self, rehearsal: Rehearsal, state: WorldState, task: MoveTask) -> tuple[Outcome, WorldState]:
        """The whole move, up to the first motion that does not end well, and the state after it.

        Each half is worked out from what feedback knows just before it.

        Raises:
            Refused: from what is now known, the rest of the move cannot be carried out; the arm stays where it is.
        """
        outcome, state = self._feedback.look(state)
        if outcome is Outcome.DONE:
            outcome, state = self._pick(rehearsal, state, task)
        if outcome is Outcome.DONE and task.place_cell is not None:
            outcome, state = self._put_down(rehearsal, state, task)
        return (self._feedback.placed(task) if outcome is Outcome.DONE else outcome), state

    def _pick(self, rehearsal: Rehearsal, state: WorldState, task: MoveTask) -> tuple[Outcome, WorldState]:
        """Reach, grasp, lift and withdraw from the grid.

        MISSED_GRASP: the object is not between the fingers. DROPPED, SLIPPED: it was, and no longer as it was.
        """
        motions, after = rehearsal.pick_up(state, task)
        for motion in ("reach", "approach"):
            self._follow(motions[motion])
        self._gripper = CLOSE_HAND
        self.hold(_GRIP_STEPS)
        self._way_out = [motions["withdraw"]]
        self._follow(motions["lift"])
        outcome = self._feedback.lifted(task.body)
        if outcome is not Outcome.DONE:
            return outcome, after
        self._follow(motions["withdraw"])
        self._way_out = []
        return self._feedback.still_held(task.body), after

    def _put_down(self, rehearsal: Rehearsal, state: WorldState, task: MoveTask) -> tuple[Outcome, WorldState]:
        """Carry what is held to its corridor, bring it into its cell, lower it, let go and leave.

        DROPPED, SLIPPED: on the way.
        """
        motions, after = rehearsal.put_down(state, task, self._feedback.held_xy(task.body))
        for motion in ("carry", "insert"):
            self._follow(motions[motion])
            if motion == "insert":
                self._way_out = [motions["insert"][::-1]]
            outcome = self._feedback.still_held(task.body)
            if outcome is not Outcome.DONE:
                return outcome, state
        self._follow(motions["lower"])
        self._let_go()
        self._follow(motions["leave"])
        self._way_out = []
        return Outcome.DONE, after

    def recover(self) -> None:
        """After a fault: open the hand, and leave the grid the way it came."""
        self._let_go()
        for commands in self._way_out:
            self._follow(commands)
        self._way_out = []

    def park(self, rehearsal: Rehearsal, state: WorldState) -> None:
        """Go to where the arm stood at the start, out of the camera's way.

        Raises:
            Refused: something is in the way.
        """
        self._follow(rehearsal.park(state, self.joints))

    def _let_go(self) -> None:
        self._gripper = OPEN_HAND
        self.hold(_RELEASE_STEPS)

    def _follow(self, commands: Array) -> None:
        for joints in commands:
            self._command(joints)
        self.hold(_SETTLE_STEPS)

    def _command(self, joints: Array) -> None:
        self.joints = joints
        action = torch.from_numpy(np.append(joints, self._gripper)).to(torch.float32)
        self._env.step(action)
        self.steps += 1
        self._after_step()
