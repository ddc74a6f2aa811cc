"""The dry run: motions worked out and checked in kinematics before anything moves.

Everything here is a function of a known state of the world and a task: it gives the motions and the state that they
lead to, or refuses and says why. Nothing is remembered between calls.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dore.sim.config import Body
from dore.sim.frames import TABLE_OVERHANG_M, Array, Corridor, corridor, turned
from dore.sim.kinematics import ArmKinematics, Reached, Unreachable, timed
from dore.sim.motion.collision import CollisionChecker, Held, Standing
from dore.sim.motion.outcome import Outcome, Refused
from dore.world.layout import Layout
from dore.world.plan import Plan
from dore.world.problem import Scene, cell_id

_SET_DOWN_GAP_M = 0.001
"""A carried object is let go this far above the table, metres."""


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


@dataclass(frozen=True)
class WorldState:
    """Where the arm and the objects are, as far as is known.

    arm: joints and hand. standing: the objects on the table, by index. cell_of: each object's cell, from 0; of a held
    one, where it came from.
    """

    arm: Reached
    standing: Mapping[int, Standing]
    cell_of: Mapping[int, int]


Motions = dict[str, Array]
"""Joint commands Float64[T, J] of each motion, by name, in order."""


@dataclass(frozen=True)
class _Motion:
    """A straight motion of the hand, and what it must not touch."""

    name: str
    xy: Array | tuple[float, float]
    z: float
    heading_rad: float
    standing: Mapping[int, Standing]
    held: Held | None = None
    reached_for: int | None = None


class Rehearsal:
    """Works out the motions of a move, half by half.

    Args:
        layout: where the cells are.
        kinematics: the arm.
        bodies: the objects, the target first.
        dt: seconds between two joint commands.
    """

    def __init__(self, layout: Layout, kinematics: ArmKinematics, bodies: Sequence[Body], dt: float) -> None:
        self._layout, self._kinematics, self._dt = layout, kinematics, dt
        self._arm, self._staging_x = kinematics.arm, layout.front_m - kinematics.arm.staging_m
        self._checker = CollisionChecker(kinematics, bodies, layout.front_m - TABLE_OVERHANG_M)

    def start(self, scene: Scene, standing: Mapping[int, Standing] | None = None) -> WorldState:
        """The arm ready, and each object where it stands; None: in the middle of its cell.

        Raises:
            Refused: the arm cannot reach the middle of the staging line.
        """
        cell_of = dict(enumerate((scene.target, *scene.obstacles)))
        if standing is None:
            standing = {body: Standing(self._layout.cells[cell]) for body, cell in cell_of.items()}
        try:
            ready = self._kinematics.ready(self._staging_x)
        except Unreachable as error:
            raise Refused(Outcome.OUT_OF_REACH, "start", str(error)) from None
        return WorldState(ready, standing, cell_of)

    def play(self, state: WorldState, tasks: Sequence[MoveTask]) -> WorldState:
        """All moves as planned; the state after them.

        Raises:
            Refused: the first motion that the arm cannot follow, or on which something would be touched.
        """
        for task in tasks:
            _, state = self.pick_up(state, task)
            if task.place_cell is not None:
                _, state = self.put_down(state, task)
        return state

    def pick_up(self, state: WorldState, task: MoveTask) -> tuple[Motions, WorldState]:
        """reach (along the staging line), approach, lift and withdraw.

        Raises:
            Refused: as `play`.
        """
        low, high = self._arm.grasp_height_m, self._arm.grasp_height_m + self._arm.lift_m
        body, held = task.body, Held(task.body)
        way = self._corridor(task, state.standing[body].xy, task.pick_direction_deg)
        heading, rest = way.heading_rad, {key: one for key, one in state.standing.items() if key != body}
        return self._chain(task, state, WorldState(state.arm, rest, state.cell_of), [
            _Motion("reach", way.staging_xy, low, heading, state.standing, reached_for=body),
            _Motion("approach", way.cell_xy, low, heading, state.standing, reached_for=body),
            _Motion("lift", way.cell_xy, high, heading, rest, held),
            _Motion("withdraw", way.staging_xy, high, heading, rest, held),
        ])  # fmt: skip

    def put_down(
        self, state: WorldState, task: MoveTask, held_xy: tuple[float, float] | None = None
    ) -> tuple[Motions, WorldState]:
        """carry (along the staging line), insert, lower and leave.

        held_xy: where the held object's axis is, metres: a cuboid that the jaws turned is up to 10 mm off; None: at the
            tool point.

        Raises:
            Refused: as `play`.
        """
        if task.place_cell is None:
            raise ValueError(f"{task.name}: no cell to put it down in")
        body, high = task.body, self._arm.grasp_height_m + self._arm.lift_m
        low, held = self._arm.grasp_height_m + _SET_DOWN_GAP_M, _in_hand(body, state.arm, held_xy)
        way = self._corridor(task, self._layout.cells[task.place_cell], task.place_direction_deg)
        heading = way.heading_rad
        # The object, not the tool point, is to end in the middle of the cell.
        aside = turned(np.array([held.along_m, held.across_m]), heading)
        begin, end, rest = way.staging_xy - aside, way.cell_xy - aside, state.standing
        # The jaws have turned a cuboid to face them, so it now stands as the hand was headed.
        after = {**rest, body: Standing(way.cell_xy, heading)}
        return self._chain(
            task, state, WorldState(state.arm, after, {**state.cell_of, body: task.place_cell}), [
                _Motion("carry", begin, high, heading, rest, held),
                _Motion("insert", end, high, heading, rest, held),
                _Motion("lower", end, low, heading, rest, held),
                _Motion("leave", begin, low, heading, after, reached_for=body),
            ])  # fmt: skip

    def park(self, state: WorldState, joints: Array) -> Array:
        """Joint commands Float64[T, J] from `joints`, the hand anywhere in front of the grid, to the ready posture.

        Raises:
            Refused: as `play`.
        """
        ready = self._kinematics.ready(self._staging_x)
        home = _Motion("park", ready.xyz[:2], float(ready.xyz[2]), ready.heading_rad, state.standing)
        commands, _ = self._go("park", self._kinematics.reached(joints), home, state.cell_of)
        return commands

    def _chain(
        self, task: MoveTask, state: WorldState, after: WorldState, chain: Sequence[_Motion]
    ) -> tuple[Motions, WorldState]:
        motions, at = {}, state.arm
        for motion in chain:
            motions[motion.name], at = self._go(task.name, at, motion, after.cell_of)
        return motions, WorldState(at, after.standing, after.cell_of)

    def _go(self, where: str, start: Reached, motion: _Motion, cell_of: Mapping[int, int]) -> tuple[Array, Reached]:
        xyz, arm = np.array([*motion.xy, motion.z]), self._arm
        try:
            path, end = self._kinematics.line(start, xyz, motion.heading_rad)
        except Unreachable as error:
            raise Refused(Outcome.OUT_OF_REACH, where, f"{motion.name}: {error}") from None
        contact = self._checker.first_contact(path, motion.standing, motion.held, motion.reached_for)
        if contact is not None:
            other = contact.other
            if contact.body is not None:
                other = f"{'target' if contact.body == 0 else 'object'} on cell {cell_id(cell_of[contact.body])}"
            raise Refused(Outcome.BLOCKED, where, f"{motion.name}: the {contact.part} would touch the {other}")
        commands = timed(
            np.vstack([start.joints, path]), float(np.linalg.norm(xyz - start.xyz)), self._dt,
            arm.lift_speed_m_s if motion.name in ("lift", "lower") else arm.hand_speed_m_s,
            arm.joint_speed * self._kinematics.speed_limit, arm.joint_acceleration * np.array(arm.model.acceleration),
        )  # fmt: skip
        return commands, end

    def _corridor(self, task: MoveTask, cell_xy: tuple[float, float], direction_deg: float) -> Corridor:
        try:
            way = corridor(cell_xy, direction_deg, self._staging_x)
        except ValueError as error:
            raise Refused(Outcome.OUT_OF_REACH, task.name, str(error)) from None
        heading, side = math.degrees(way.heading_rad), way.staging_xy[1]
        for text, value, limit in (
            (f"heads {heading:.1f} deg", heading, self._arm.max_yaw_deg),
            (f"begins at y = {side:.3f} m", side, self._arm.lateral_limit_m),
        ):
            if abs(value) > limit + 1e-6:
                raise Refused(Outcome.OUT_OF_REACH, task.name, f"its corridor {text}, want within +-{limit:g}")
        return way


def _in_hand(body: int, arm: Reached, held_xy: tuple[float, float] | None) -> Held:
    """A held object, where its axis is seen from the tool point."""
    if held_xy is None:
        return Held(body)
    return Held(body, *turned(held_xy - arm.xyz[:2], -arm.heading_rad).tolist())
