"""The whole plan in kinematics, before anything moves: each motion as joint commands, or a refusal that says why."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dore.layout import Layout
from dore.plan import Plan, Scene, cell_id
from dore.sim.collision import CollisionChecker, Standing
from dore.sim.config import ArmConfig, Body
from dore.sim.frames import Array, Lane, lane
from dore.sim.kinematics import ArmKinematics, Reached, Unreachable
from dore.sim.outcome import Outcome
from dore.sim.timing import timed

# Franka Emika's published joint acceleration limits, rad/s^2.
_ACCELERATION_LIMIT = np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0])
_SET_DOWN_GAP_M = 0.001
"""How far above the table a carried object is let go, metres."""


class Refused(Exception):
    """A plan that the arm cannot carry out. `outcome`: why, `where`: which move; the message says it in words."""

    def __init__(self, outcome: Outcome, where: str, reason: str) -> None:
        super().__init__(f"{where}: {reason}")
        self.outcome, self.where = outcome, where


@dataclass(frozen=True)
class RehearsedMove:
    """Joint commands Float64[T, 7] of each motion of one move; the target's has no `place_cell`.

    Motions, in order: reach (to the staging line), approach, lift, withdraw; and where it is put down: carry,
    insert, lower, leave.
    """

    name: str
    body: int
    pick_cell: int
    place_cell: int | None
    motions: dict[str, Array]


@dataclass
class Rehearsal:
    """Plays a plan through the kinematics, one motion after the other.

    Args:
        layout: where the cells are.
        bodies: the objects, the target first.
        standing: where each of them stands at the start, by index.
        dt: seconds between two joint commands.
    """

    layout: Layout
    kinematics: ArmKinematics
    checker: CollisionChecker
    bodies: Sequence[Body]
    standing: dict[int, Standing]
    dt: float
    _at: Reached = field(init=False)
    _where: str = field(init=False, default="start")
    _cell_of: dict[int, int] = field(init=False)

    def __post_init__(self) -> None:
        self._cell_of = {}
        self._at = self.kinematics.ready(self.staging_x)

    @property
    def arm(self) -> ArmConfig:
        """How the arm stands and moves."""
        return self.kinematics.arm

    @property
    def staging_x(self) -> float:
        """x of the staging line, metres."""
        return self.layout.front_m - self.arm.staging_m

    def play(self, scene: Scene, plan: Plan) -> tuple[RehearsedMove, ...]:
        """Every move of the plan, the target's retrieval last.

        Raises:
            Refused: the first motion that the arm cannot follow, or on which something would be touched.
        """
        self._cell_of = dict(enumerate((scene.target, *scene.obstacles)))
        moves = []
        for number, move in enumerate(plan.moves, 1):
            self._where = f"move {number} ({cell_id(move.pick)} to {cell_id(move.place)})"
            body = next(i for i, cell in self._cell_of.items() if cell == move.pick)
            motions = self._pick(body, move.pick_direction_deg)
            motions |= self._place(body, move.place, move.place_direction_deg)
            moves.append(RehearsedMove(self._where, body, move.pick, move.place, motions))
        if plan.target_direction_deg is not None:
            self._where = f"target ({cell_id(scene.target)})"
            motions = self._pick(0, plan.target_direction_deg)
            moves.append(RehearsedMove(self._where, 0, scene.target, None, motions))
        return tuple(moves)

    def _pick(self, body: int, direction_deg: float) -> dict[str, Array]:
        low, high = self.arm.grasp_height_m, self.arm.grasp_height_m + self.arm.lift_m
        way = self._lane(self.standing[body].xy, direction_deg)
        motions = {
            "reach": self._go("reach", way.staging_xy, low, way.heading_rad, reached_for=body),
            "approach": self._go("approach", way.cell_xy, low, way.heading_rad, reached_for=body),
        }
        del self.standing[body]
        motions["lift"] = self._go("lift", way.cell_xy, high, way.heading_rad, held=body)
        motions["withdraw"] = self._go("withdraw", way.staging_xy, high, way.heading_rad, held=body)
        return motions

    def _place(self, body: int, cell: int, direction_deg: float) -> dict[str, Array]:
        low, high = self.arm.grasp_height_m, self.arm.grasp_height_m + self.arm.lift_m
        way = self._lane(self.layout.cells[cell], direction_deg)
        heading = way.heading_rad
        motions = {
            "carry": self._go("carry", way.staging_xy, high, heading, held=body),
            "insert": self._go("insert", way.cell_xy, high, heading, held=body),
            "lower": self._go("lower", way.cell_xy, low + _SET_DOWN_GAP_M, heading, held=body),
        }
        # The jaws have turned a cuboid to face them, so it now stands as the hand was headed.
        self.standing[body], self._cell_of[body] = Standing(way.cell_xy, heading), cell
        motions["leave"] = self._go("leave", way.staging_xy, low + _SET_DOWN_GAP_M, heading, reached_for=body)
        return motions

    def _lane(self, cell_xy: tuple[float, float], direction_deg: float) -> Lane:
        try:
            way = lane(cell_xy, direction_deg, self.staging_x)
        except ValueError as error:
            raise Refused(Outcome.OUT_OF_REACH, self._where, str(error)) from None
        heading, side = math.degrees(way.heading_rad), way.staging_xy[1]
        if abs(heading) > self.arm.heading_limit_deg + 1e-6:
            limit = f"+-{self.arm.heading_limit_deg:g}"
            raise Refused(Outcome.OUT_OF_REACH, self._where, f"its lane heads {heading:.1f} deg, want within {limit}")
        if abs(side) > self.arm.lateral_limit_m + 1e-6:
            limit = f"+-{self.arm.lateral_limit_m:g}"
            raise Refused(
                Outcome.OUT_OF_REACH, self._where, f"its lane begins at y = {side:.3f} m, want within {limit}"
            )
        return way

    def _go(
        self, motion: str, xy: tuple[float, float], z: float, heading: float,
        held: int | None = None, reached_for: int | None = None,
    ) -> Array:  # fmt: skip
        start, xyz = self._at, np.array([*xy, z])
        try:
            path, self._at = self.kinematics.line(start, xyz, heading)
        except Unreachable as error:
            raise Refused(Outcome.OUT_OF_REACH, self._where, f"{motion}: {error}") from None
        contact = self.checker.first_contact(path, self.standing, held, reached_for)
        if contact is not None:
            other = contact.other if contact.body is None else self._name(contact.body)
            reason = f"{motion}: the {contact.part} would touch the {other}"
            raise Refused(Outcome.BLOCKED, self._where, reason)
        arm = self.arm
        return timed(
            np.vstack([start.joints, path]), float(np.linalg.norm(xyz - start.xyz)), self.dt,
            arm.lift_speed_m_s if motion in ("lift", "lower") else arm.hand_speed_m_s,
            arm.joint_speed * self.kinematics.speed_limit, arm.joint_acceleration * _ACCELERATION_LIMIT,
        )  # fmt: skip

    def _name(self, body: int) -> str:
        return f"{'target' if body == 0 else 'object'} on cell {cell_id(self._cell_of[body])}"
