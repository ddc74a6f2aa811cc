"""The whole plan in kinematics, before anything moves: each motion as joint commands, or a refusal that says why."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dore.sim.config import ArmConfig
from dore.sim.motion.collision import CollisionChecker, Standing
from dore.sim.motion.frames import Array, Lane, lane
from dore.sim.motion.kinematics import ArmKinematics, Unreachable
from dore.sim.motion.outcome import Outcome
from dore.sim.motion.timing import timed
from dore.world.layout import Layout
from dore.world.plan import Plan, Scene, cell_id

_SET_DOWN_GAP_M = 0.001
"""How far above the table a carried object is let go, metres."""


class Refused(Exception):
    """A plan that the arm cannot carry out. `outcome`: why, `where`: which move; the message says it in words."""

    def __init__(self, outcome: Outcome, where: str, reason: str) -> None:
        super().__init__(f"{where}: {reason}")
        self.outcome, self.where = outcome, where


@dataclass(frozen=True)
class MoveTask:
    """One pick-and-place of a plan; the target's has no `place_cell`. Cells count from 0, `body` is an object's index.

    Directions are degrees about cell-to-base, counter-clockwise.
    """

    name: str
    body: int
    pick_cell: int
    pick_direction_deg: float
    place_cell: int | None = None
    place_direction_deg: float = 0.0


def tasks_of(scene: Scene, plan: Plan, first: int = 1) -> tuple[MoveTask, ...]:
    """A plan as moves of objects, the target (index 0) last; obstacles count from 1 in the scene's order.

    first: the number of its first move.
    """
    body_on = {cell: index for index, cell in enumerate((scene.target, *scene.obstacles))}
    tasks = []
    for number, move in enumerate(plan.moves, first):
        body = body_on[move.place] = body_on.pop(move.pick)
        name = f"move {number} ({cell_id(move.pick)} to {cell_id(move.place)})"
        tasks.append(MoveTask(name, body, move.pick, move.pick_direction_deg, move.place, move.place_direction_deg))
    if plan.target_direction_deg is not None:
        tasks.append(MoveTask(f"target ({cell_id(scene.target)})", 0, scene.target, plan.target_direction_deg))
    return tuple(tasks)


Motions = dict[str, Array]
"""Joint commands Float64[T, J] of each motion, by name, in order."""


class Rehearsal:
    """Works out the motions of one half-move after the other, from where the last one ended.

    The whole plan is played through it before anything moves. While the arm moves it is begun again, and told
    before each half-move what is seen: a cuboid that the jaws turned lies up to 10 mm off in the hand.

    Args:
        layout: where the cells are.
        kinematics: the arm.
        checker: what it must not touch.
        dt: seconds between two joint commands.
    """

    def __init__(self, layout: Layout, kinematics: ArmKinematics, checker: CollisionChecker, dt: float) -> None:
        self.layout, self.kinematics, self.checker, self.dt = layout, kinematics, checker, dt
        self.standing: dict[int, Standing] = {}
        self.cell_of: dict[int, int] = {}
        self._task = "start"

    def begin(self, scene: Scene) -> None:
        """The arm stands ready, and every object in the middle of its cell.

        Raises:
            Refused: the arm cannot reach the middle of the staging line.
        """
        self.cell_of = dict(enumerate((scene.target, *scene.obstacles)))
        self.standing = {body: Standing(self.layout.cells[cell]) for body, cell in self.cell_of.items()}
        self._task = "start"
        try:
            self._at = self.kinematics.ready(self.staging_x)
        except Unreachable as error:
            raise Refused(Outcome.OUT_OF_REACH, self._task, str(error)) from None

    def play(self, tasks: Sequence[MoveTask]) -> None:
        """All moves as planned.

        Raises:
            Refused: the first motion that the arm cannot follow, or on which something would be touched.
        """
        for task in tasks:
            self.pick_up(task)
            if task.place_cell is not None:
                self.put_down(task)

    @property
    def arm(self) -> ArmConfig:
        """How the arm stands and moves."""
        return self.kinematics.arm

    @property
    def staging_x(self) -> float:
        """x of the staging line, metres."""
        return self.layout.front_m - self.arm.staging_m

    def pick_up(self, task: MoveTask) -> Motions:
        """reach (along the staging line), approach, lift and withdraw.

        Raises:
            Refused: as `play`.
        """
        self._task = task.name
        low, high = self.arm.grasp_height_m, self.arm.grasp_height_m + self.arm.lift_m
        body, way = task.body, self._lane(self.standing[task.body].xy, task.pick_direction_deg)
        motions = {
            "reach": self._go("reach", way.staging_xy, low, way.heading_rad, reached_for=body),
            "approach": self._go("approach", way.cell_xy, low, way.heading_rad, reached_for=body),
        }
        del self.standing[body]
        self.checker.grasp(body, 0.0, 0.0)
        motions["lift"] = self._go("lift", way.cell_xy, high, way.heading_rad, held=body)
        motions["withdraw"] = self._go("withdraw", way.staging_xy, high, way.heading_rad, held=body)
        return motions

    def put_down(self, task: MoveTask, seen_xy: tuple[float, float] | None = None) -> Motions:
        """carry (along the staging line), insert, lower and leave.

        seen_xy: where the held object's axis is, metres; None: right at the tool point.

        Raises:
            Refused: as `play`.
        """
        if task.place_cell is None:
            raise ValueError(f"{task.name}: there is nowhere to put it down")
        body, high = task.body, self.arm.grasp_height_m + self.arm.lift_m
        low = self.arm.grasp_height_m + _SET_DOWN_GAP_M
        along, across = self._in_hand(seen_xy)
        self.checker.grasp(body, along, across)
        way = self._lane(self.layout.cells[task.place_cell], task.place_direction_deg)
        heading, (c, s) = way.heading_rad, (math.cos(way.heading_rad), math.sin(way.heading_rad))
        # The object, not the tool point, is to end in the middle of the cell.
        aside = np.array([c * along - s * across, s * along + c * across])
        start, end = way.staging_xy - aside, way.cell_xy - aside
        motions = {
            "carry": self._go("carry", start, high, heading, held=body),
            "insert": self._go("insert", end, high, heading, held=body),
            "lower": self._go("lower", end, low, heading, held=body),
        }
        # The jaws have turned a cuboid to face them, so it now stands as the hand was headed.
        self.standing[body], self.cell_of[body] = Standing(way.cell_xy, heading), task.place_cell
        motions["leave"] = self._go("leave", start, low, heading, reached_for=body)
        return motions

    def park(self, joints: Array) -> Array:
        """Joint commands Float64[T, J] from before the grid, wherever the arm is there, to its ready posture.

        Raises:
            Refused: as `play`.
        """
        self._task, self._at = "park", self.kinematics.reached(joints)
        ready = self.kinematics.ready(self.staging_x)
        return self._go("park", ready.xyz[:2], float(ready.xyz[2]), ready.heading_rad)

    def _in_hand(self, seen_xy: tuple[float, float] | None) -> tuple[float, float]:
        """Where the held object's axis is seen from the tool point: along the heading and across it, metres."""
        if seen_xy is None:
            return 0.0, 0.0
        dx, dy = seen_xy[0] - self._at.xyz[0], seen_xy[1] - self._at.xyz[1]
        c, s = math.cos(self._at.heading_rad), math.sin(self._at.heading_rad)
        return float(c * dx + s * dy), float(c * dy - s * dx)

    def _lane(self, cell_xy: tuple[float, float], direction_deg: float) -> Lane:
        try:
            way = lane(cell_xy, direction_deg, self.staging_x)
        except ValueError as error:
            raise Refused(Outcome.OUT_OF_REACH, self._task, str(error)) from None
        heading, side = math.degrees(way.heading_rad), way.staging_xy[1]
        if abs(heading) > self.arm.heading_limit_deg + 1e-6:
            limit = f"+-{self.arm.heading_limit_deg:g}"
            raise Refused(Outcome.OUT_OF_REACH, self._task, f"its lane heads {heading:.1f} deg, want within {limit}")
        if abs(side) > self.arm.lateral_limit_m + 1e-6:
            limit = f"+-{self.arm.lateral_limit_m:g}"
            raise Refused(Outcome.OUT_OF_REACH, self._task, f"its lane begins at y = {side:.3f} m, want within {limit}")
        return way

    def _go(
        self, motion: str, xy: Array | tuple[float, float], z: float, heading: float,
        held: int | None = None, reached_for: int | None = None,
    ) -> Array:  # fmt: skip
        start, xyz = self._at, np.array([*xy, z])
        try:
            path, self._at = self.kinematics.line(start, xyz, heading)
        except Unreachable as error:
            raise Refused(Outcome.OUT_OF_REACH, self._task, f"{motion}: {error}") from None
        contact = self.checker.first_contact(path, self.standing, held, reached_for)
        if contact is not None:
            other = contact.other if contact.body is None else self._name(contact.body)
            reason = f"{motion}: the {contact.part} would touch the {other}"
            raise Refused(Outcome.BLOCKED, self._task, reason)
        arm = self.arm
        return timed(
            np.vstack([start.joints, path]), float(np.linalg.norm(xyz - start.xyz)), self.dt,
            arm.lift_speed_m_s if motion in ("lift", "lower") else arm.hand_speed_m_s,
            arm.joint_speed * self.kinematics.speed_limit, arm.joint_acceleration * np.array(arm.model.acceleration),
        )  # fmt: skip

    def _name(self, body: int) -> str:
        return f"{'target' if body == 0 else 'object'} on cell {cell_id(self.cell_of[body])}"
