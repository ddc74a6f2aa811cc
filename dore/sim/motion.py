"""Drives the arm through rehearsed motions, and tells by the simulator's state how each of them ended."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from dore.sim.frames import Array, inside
from dore.sim.outcome import Outcome
from dore.sim.rehearsal import RehearsedMove
from dore.sim.task import UPRIGHT_DEG, DoreTabletopEnv

_OPEN, _CLOSED = 1.0, -1.0
_SETTLE_STEPS = 4
_GRIP_STEPS = 10
_RELEASE_STEPS = 8
_HELD_WITHIN_M = 0.03
"""A held object's axis stays this near the tool point, seen from above."""


class Operator:
    """The arm in a running environment.

    Args:
        env: a `DoreTabletop-v1` made with `control_mode="pd_joint_pos"`, as gymnasium returns it, after a reset.
        after_step: called after every control step (the video's camera).
    """

    def __init__(self, env: Any, after_step: Callable[[], None]) -> None:
        self._env, self._after_step = env, after_step
        self._task: DoreTabletopEnv = env.unwrapped
        self._gripper = _OPEN
        self._joints: Array = self._task.agent.robot.get_qpos()[0, :7].double().cpu().numpy()
        self.steps = 0

    @property
    def simulated_s(self) -> float:
        """Simulated seconds since the start."""
        return self.steps / self._task.control_freq

    def positions(self) -> Array:
        """Float64[N, 3]: centre of each object, metres, world frame."""
        return np.asarray(self._task.positions()[0].double().cpu().numpy())

    def leaning_deg(self) -> Array:
        """Float64[N]: how far each object leans, degrees."""
        return np.asarray(self._task.leaning_deg()[0].double().cpu().numpy())

    def conditions(self) -> dict[str, bool]:
        """The task's named conditions and `success`."""
        return {name: bool(value[0]) for name, value in self._task.evaluate().items()}

    def hold(self, steps: int) -> None:
        """Stay where the arm is for some control steps."""
        for _ in range(steps):
            self._command(self._joints)

    def pick(self, move: RehearsedMove) -> Outcome:
        """Reach, grasp and lift. MISSED_GRASP: what the move names is not between the fingers."""
        for motion in ("reach", "approach"):
            self._follow(move.motions[motion])
        self._gripper = _CLOSED
        self.hold(_GRIP_STEPS)
        self._follow(move.motions["lift"])
        return Outcome.DONE if self._holds(move.body) else Outcome.MISSED_GRASP

    def carry(self, move: RehearsedMove) -> Outcome:
        """Withdraw from the grid and, where the object is to be put down, go before its lane. DROPPED: lost."""
        for motion in ("withdraw", "carry"):
            if motion in move.motions:
                self._follow(move.motions[motion])
                if not self._holds(move.body):
                    return Outcome.DROPPED
        return Outcome.DONE

    def place(self, move: RehearsedMove) -> Outcome:
        """Bring the object into its cell, lower it and let go. DROPPED: lost on the way in."""
        self._follow(move.motions["insert"])
        if not self._holds(move.body):
            return Outcome.DROPPED
        self._follow(move.motions["lower"])
        self._gripper = _OPEN
        self.hold(_RELEASE_STEPS)
        return Outcome.DONE

    def retreat(self, move: RehearsedMove) -> Outcome:
        """Leave the grid. MISPLACED or TOPPLED: the object put down does not stand in its cell, or not upright."""
        self._follow(move.motions["leave"])
        if self.leaning_deg()[move.body] > UPRIGHT_DEG:
            return Outcome.TOPPLED
        layout = self._task.layout
        cells = inside(layout.centres.numpy(), layout.cell_m, self.positions()[move.body, :2])
        return Outcome.DONE if move.place_cell is not None and cells[move.place_cell] else Outcome.MISPLACED

    def run(self, move: RehearsedMove) -> Outcome:
        """The whole move, up to the first motion that does not end well; then a look at all other objects."""
        before = self.positions()
        motions = [self.pick, self.carry] + ([self.place, self.retreat] if move.place_cell is not None else [])
        for motion in motions:
            outcome = motion(move)
            if outcome is not Outcome.DONE:
                return outcome
        return self._others(move, before)

    def _others(self, move: RehearsedMove, before: Array) -> Outcome:
        """TOPPLED or PUSHED where an object that was not to be moved has been."""
        others = np.arange(len(before)) != move.body
        if (self.leaning_deg()[others] > UPRIGHT_DEG).any():
            return Outcome.TOPPLED
        moved = np.linalg.norm(self.positions() - before, axis=1)[others]
        return Outcome.PUSHED if (moved > self._task.arm.pushed_m).any() else Outcome.DONE

    def _holds(self, body: int) -> bool:
        """Whether both fingers press on the object, it is off the table, and near the tool point."""
        task = self._task
        at, tool = self.positions()[body], task.agent.tcp_pos[0].double().cpu().numpy()
        lifted = at[2] > task.bodies[body].height_m / 2 + task.arm.lift_m / 2
        near = float(np.linalg.norm(at[:2] - tool[:2])) < _HELD_WITHIN_M
        return bool(lifted and near and task.agent.is_grasping(task.objects[body])[0])

    def _follow(self, commands: Array) -> None:
        for joints in commands:
            self._command(joints)
        self.hold(_SETTLE_STEPS)

    def _command(self, joints: Array) -> None:
        self._joints = joints
        action = torch.from_numpy(np.append(joints, self._gripper)).to(torch.float32)
        self._env.step(action)
        self.steps += 1
        self._after_step()
