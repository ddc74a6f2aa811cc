"""What the operator knows while it moves: the simulator's own state, or only what the gripper senses."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from dore.sim.frames import Array, inside
from dore.sim.motion.collision import Standing
from dore.sim.motion.outcome import Outcome
from dore.sim.motion.rehearsal import MoveTask, WorldState
from dore.sim.scene.task import UPRIGHT_DEG, DoreTabletopEnv

_HELD_WITHIN_M = 0.03
"""A held object's axis stays this near the tool point, seen from above."""
_SLIPPED_M = 0.006
"""A held object that has moved further than this in the hand since it was lifted has slipped."""
_HOLDING = (0.15, 0.95)
"""How far a hand is open that holds something: neither shut on nothing, nor wide open."""


class Feedback(Protocol):
    """What the operator asks about the world."""

    def look(self, state: WorldState) -> tuple[Outcome, WorldState]:
        """Before a move: the state with what is seen now, and DONE, or why the move cannot begin."""

    def lifted(self, body: int) -> Outcome:
        """After the lift: DONE or MISSED_GRASP."""

    def still_held(self, body: int) -> Outcome:
        """On the way: DONE, SLIPPED or DROPPED."""

    def held_xy(self, body: int) -> tuple[float, float] | None:
        """Where the axis of the held object is, metres; None: not known, so taken to be at the tool point."""

    def placed(self, task: MoveTask) -> Outcome:
        """After the hand has left: DONE, or what is wrong with the object put down, or with another one."""


class PrivilegedState:
    """The simulator's state: where every object is at any time.

    Args:
        task: the environment.
    """

    def __init__(self, task: DoreTabletopEnv) -> None:
        self._task = task
        self._before = positions(task)
        self._in_hand = np.zeros(3)

    def look(self, state: WorldState) -> tuple[Outcome, WorldState]:
        """TOPPLED, WORLD_CHANGED: an object does not stand upright, or in the cell where the state has it."""
        at = self._before = positions(self._task)
        if (leaning_deg(self._task) > UPRIGHT_DEG).any():
            return Outcome.TOPPLED, state
        if not all(self._in_cell(at[body, :2], cell) for body, cell in state.cell_of.items()):
            return Outcome.WORLD_CHANGED, state
        turned = yaws(self._task)
        seen = {body: Standing((float(at[body, 0]), float(at[body, 1])), turned[body]) for body in state.cell_of}
        return Outcome.DONE, replace(state, standing=seen)

    def lifted(self, body: int) -> Outcome:
        """MISSED_GRASP: the object is not between the fingers, or still on the table."""
        if not self._holds(body):
            return Outcome.MISSED_GRASP
        self._in_hand = self._offset(body)
        return Outcome.DONE

    def still_held(self, body: int) -> Outcome:
        """DROPPED: out of the hand. SLIPPED: in it, but not where it was."""
        if not self._holds(body):
            return Outcome.DROPPED
        slipped = float(np.linalg.norm(self._offset(body) - self._in_hand)) > _SLIPPED_M
        return Outcome.SLIPPED if slipped else Outcome.DONE

    def held_xy(self, body: int) -> tuple[float, float] | None:
        """Where it is."""
        x, y = positions(self._task)[body, :2]
        return float(x), float(y)

    def placed(self, task: MoveTask) -> Outcome:
        """TOPPLED, MISPLACED: the object put down does not stand upright, or not in its cell. TOPPLED, PUSHED:
        another one has been."""
        at, leaning = positions(self._task), leaning_deg(self._task)
        others = np.arange(len(at)) != task.body
        if (leaning[others] > UPRIGHT_DEG).any():
            return Outcome.TOPPLED
        if task.place_cell is not None:
            if leaning[task.body] > UPRIGHT_DEG:
                return Outcome.TOPPLED
            if not self._in_cell(at[task.body, :2], task.place_cell):
                return Outcome.MISPLACED
        moved = np.linalg.norm(at - self._before, axis=1)[others]
        return Outcome.PUSHED if (moved > self._task.arm.pushed_m).any() else Outcome.DONE

    def _in_cell(self, xy: Array, cell: int) -> bool:
        layout = self._task.layout
        return bool(inside(layout.centres.numpy(), layout.cell_m, xy)[cell])

    def _holds(self, body: int) -> bool:
        """Whether both fingers press on the object, it is off the table, and near the tool point."""
        task = self._task
        lifted = positions(task)[body, 2] > task.bodies[body].height_m / 2 + task.arm.lift_m / 2
        near = float(np.linalg.norm(self._offset(body)[:2])) < _HELD_WITHIN_M
        return bool(lifted and near and task.agent.is_grasping(task.objects[body])[0])

    def _offset(self, body: int) -> Array:
        """Float64[3]: the object's centre from the tool point, in the hand's own frame, metres."""
        tool = self._task.agent.tcp.pose.to_transformation_matrix()[0].double().cpu().numpy()
        return np.asarray(tool[:3, :3].T @ (positions(self._task)[body] - tool[:3, 3]))


class GripperFeedback:
    """Only what the gripper itself senses: how far its fingers are apart. The camera has looked before the move and
    looks again after it; the simulator is asked nothing else.

    Args:
        task: the environment, of which only the fingers' joints are read.
    """

    def __init__(self, task: DoreTabletopEnv) -> None:
        self._task = task

    def look(self, state: WorldState) -> tuple[Outcome, WorldState]:
        """The camera has just looked: the state as it is."""
        return Outcome.DONE, state

    def lifted(self, body: int) -> Outcome:
        """MISSED_GRASP: the fingers have closed on nothing."""
        return Outcome.DONE if self.holding() else Outcome.MISSED_GRASP

    def still_held(self, body: int) -> Outcome:
        """DROPPED: the fingers have closed on nothing."""
        return Outcome.DONE if self.holding() else Outcome.DROPPED

    def held_xy(self, body: int) -> tuple[float, float] | None:
        """Not known: fingers do not sense it."""
        return None

    def placed(self, task: MoveTask) -> Outcome:
        """The camera will see it at its next look."""
        return Outcome.DONE

    def holding(self) -> bool:
        """Whether something keeps the closed fingers apart."""
        return _HOLDING[0] < float(self._task.agent.opening()[0]) < _HOLDING[1]


def positions(task: DoreTabletopEnv) -> Array:
    """Float64[N, 3]: centre of each object, metres, world frame."""
    return np.asarray(task.positions()[0].double().cpu().numpy())


def leaning_deg(task: DoreTabletopEnv) -> Array:
    """Float64[N]: how far each object leans, degrees."""
    return np.asarray(task.leaning_deg()[0].double().cpu().numpy())


def yaws(task: DoreTabletopEnv) -> list[float]:
    """How each of N objects is turned about the vertical, radians."""
    quaternions = task.poses()[0, :, 3:].double().cpu().numpy()
    return Rotation.from_quat(quaternions, scalar_first=True).as_euler("ZYX")[:, 0].tolist()
