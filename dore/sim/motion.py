"""Drives the arm through rehearsed motions, and tells by the simulator's state how each of them ended."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from dore.sim.collision import Standing
from dore.sim.frames import Array, inside
from dore.sim.outcome import Outcome
from dore.sim.rehearsal import Motions, MoveTask, Rehearsal
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
        rehearsal: begun; it works out each motion from what is seen before it.
        after_step: called after every control step (the video's camera).
    """

    def __init__(self, env: Any, rehearsal: Rehearsal, after_step: Callable[[], None]) -> None:
        self._env, self._rehearsal, self._after_step = env, rehearsal, after_step
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

    def run(self, task: MoveTask) -> Outcome:
        """The whole move, up to the first motion that does not end well; then a look at all other objects.

        Raises:
            Refused: from what is now seen, the rest of the move cannot be carried out; the arm stays where it is.
        """
        outcome, before = self.look(), self.positions()
        if outcome is Outcome.DONE:
            outcome = self.pick(task, self._rehearsal.pick_up(task))
        if outcome is Outcome.DONE and task.place_cell is not None:
            x, y = self.positions()[task.body, :2]
            motions = self._rehearsal.put_down(task, (float(x), float(y)))
            for motion in (self.carry, self.place, self.retreat):
                outcome = motion(task, motions)
                if outcome is not Outcome.DONE:
                    break
        return self._others(task, before) if outcome is Outcome.DONE else outcome

    def look(self) -> Outcome:
        """Tell the rehearsal where each object stands. TOPPLED, WORLD_CHANGED: one does not stand where it should."""
        at, layout = self.positions(), self._task.layout
        if (self.leaning_deg() > UPRIGHT_DEG).any():
            return Outcome.TOPPLED
        for body, cell in self._rehearsal.cell_of.items():
            if not inside(layout.centres.numpy(), layout.cell_m, at[body, :2])[cell]:
                return Outcome.WORLD_CHANGED
            forward = self._task.objects[body].pose.to_transformation_matrix()[0, :2, 0].tolist()
            yaw = math.atan2(forward[1], forward[0])
            self._rehearsal.standing[body] = Standing((float(at[body, 0]), float(at[body, 1])), yaw)
        return Outcome.DONE

    def pick(self, task: MoveTask, motions: Motions) -> Outcome:
        """Reach, grasp, lift and withdraw from the grid.

        MISSED_GRASP: the object is not between the fingers. DROPPED: it was, and is no longer.
        """
        for motion in ("reach", "approach"):
            self._follow(motions[motion])
        self._gripper = _CLOSED
        self.hold(_GRIP_STEPS)
        self._follow(motions["lift"])
        if not self._holds(task.body):
            return Outcome.MISSED_GRASP
        self._follow(motions["withdraw"])
        return self._still_held(task)

    def carry(self, task: MoveTask, motions: Motions) -> Outcome:
        """Go before the lane of the cell where the object is to be put down. DROPPED: lost on the way."""
        self._follow(motions["carry"])
        return self._still_held(task)

    def place(self, task: MoveTask, motions: Motions) -> Outcome:
        """Bring the object into its cell, lower it and let go. DROPPED: lost on the way in."""
        self._follow(motions["insert"])
        if not self._holds(task.body):
            return Outcome.DROPPED
        self._follow(motions["lower"])
        self._gripper = _OPEN
        self.hold(_RELEASE_STEPS)
        return Outcome.DONE

    def retreat(self, task: MoveTask, motions: Motions) -> Outcome:
        """Leave the grid. MISPLACED or TOPPLED: the object put down does not stand in its cell, or not upright."""
        self._follow(motions["leave"])
        if self.leaning_deg()[task.body] > UPRIGHT_DEG:
            return Outcome.TOPPLED
        layout = self._task.layout
        cells = inside(layout.centres.numpy(), layout.cell_m, self.positions()[task.body, :2])
        return Outcome.DONE if task.place_cell is not None and cells[task.place_cell] else Outcome.MISPLACED

    def _still_held(self, task: MoveTask) -> Outcome:
        return Outcome.DONE if self._holds(task.body) else Outcome.DROPPED

    def _others(self, task: MoveTask, before: Array) -> Outcome:
        """TOPPLED or PUSHED where an object that was not to be moved has been."""
        others = np.arange(len(before)) != task.body
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
