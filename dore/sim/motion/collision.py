"""Contacts of the arm, and of what it carries, on a joint path; found by coal through Pinocchio."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin

from dore.sim.config import Body
from dore.sim.frames import Array, hand_pose
from dore.sim.kinematics import ArmKinematics

_GRASP_MARGIN_M = 0.001
_TABLE_MARGIN_M = 0.005
_BOTTOM_GAP_M = 0.004


@dataclass(frozen=True)
class Standing:
    """An upright body on the table: (x, y) of its axis in metres, and how it is turned, radians."""

    xy: tuple[float, float]
    yaw_rad: float = 0.0


@dataclass(frozen=True)
class Held:
    """A body in the hand, upright; its axis along the heading from the tool point, and to its left, metres."""

    body: int
    along_m: float = 0.0
    across_m: float = 0.0


@dataclass(frozen=True)
class Contact:
    """The first contact on a path. `part`: of the arm, in words; `body`: the object touched, None: table or arm."""

    part: str
    other: str
    body: int | None


class CollisionChecker:
    """The arm's convex parts against objects, table, itself, and the same for a carried object.

    Args:
        kinematics: the arm.
        bodies: the objects, by index.
        table_front_x: x of the table's near edge, metres.
    """

    def __init__(self, kinematics: ArmKinematics, bodies: Sequence[Body], table_front_x: float) -> None:
        self._kin, self._bodies = kinematics, tuple(bodies)
        self._drop = kinematics.arm.base_drop_m
        self._model, self._scene = kinematics.model, kinematics.geometry.copy()
        self._tool = self._model.getFrameId(kinematics.arm.model.tool_link)
        self._robot = list(range(self._scene.ngeoms))
        box = pin.SE3(np.eye(3), np.array([table_front_x + 0.5, 0.0, self._drop - 0.02]))
        self._table = self._fixed("table", coal.Box(1.0, 2.0, 0.04), box)
        self._standing = [self._fixed(f"object{i}", _solid(b), pin.SE3.Identity()) for i, b in enumerate(bodies)]
        self._carried = [self._held(i, body) for i, body in enumerate(bodies)]
        self._pair_up()
        self._data = self._scene.createData()
        self._kin_data = self._model.createData()

    def first_contact(
        self, path: Array, standing: Mapping[int, Standing], held: Held | None = None, reached_for: int | None = None
    ) -> Contact | None:
        """What the arm touches first on a joint path Float64[N, J]; None: nothing.

        standing: where each object on the table stands.
        held: the object in the hand; if it is in `standing` too, it is not met there.
        reached_for: the object between the open fingers, which may come close but not touch.
        """
        self._arrange(standing, held, reached_for)
        for joints in path:
            if pin.computeCollisions(self._model, self._kin_data, self._scene, self._data, joints, True):
                return self._name_contact()
        return None

    def touched(
        self, path: Array, standing: Mapping[int, Standing], held: Held | None = None, reached_for: int | None = None
    ) -> set[int]:
        """All objects that the arm, or what it holds, touches on a joint path Float64[N, J]; arguments as above."""
        self._arrange(standing, held, reached_for)
        found: set[int] = set()
        for joints in path:
            if pin.computeCollisions(self._model, self._kin_data, self._scene, self._data, joints, False):
                found |= {self._standing.index(b) for _, b in self._hits() if b in self._standing}
        return found

    def _fixed(self, name: str, shape: coal.CollisionGeometry, where: pin.SE3) -> int:
        return self._scene.addGeometryObject(pin.GeometryObject(name, 0, 0, where, shape))

    def _held(self, index: int, body: Body) -> int:
        """The body in the hand, upright."""
        shape = _solid(Body(body.shape, body.half_width_m, body.height_m - _BOTTOM_GAP_M))
        joint = self._model.frames[self._tool].parentJoint
        placement = self._in_hand(Held(index))
        return self._scene.addGeometryObject(pin.GeometryObject(f"carried{index}", joint, joint, placement, shape))

    def _in_hand(self, held: Held) -> pin.SE3:
        """Pose of a held body in the last joint's frame; its bottom a little above the table that it leaves."""
        arm = self._kin.arm
        tool = pin.SE3(hand_pose(np.array([0.0, 0.0, arm.grasp_height_m]), 0.0, arm.tilt_rad))
        height = (self._bodies[held.body].height_m + _BOTTOM_GAP_M) / 2
        upright = pin.SE3(np.eye(3), np.array([held.along_m, held.across_m, height]))
        return self._model.frames[self._tool].placement * tool.actInv(upright)

    def _pair_up(self) -> None:
        """All pairs that may ever be asked about; `_arrange` chooses among them."""
        pairs = [(a, b) for a in self._robot for b in (self._table, *self._standing)]
        # The last two links are the wrist that holds it.
        last = self._model.njoints - 1
        arm_only = [i for i in self._robot if self._scene.geometryObjects[i].parentJoint <= last - 2]
        for i, carried in enumerate(self._carried):
            pairs += [(carried, other) for other in self._standing if other != self._standing[i]]
            pairs += [(carried, part) for part in (*arm_only, self._table)]
        for a in self._robot:
            near = self._scene.geometryObjects[a].parentJoint
            pairs += [(a, b) for b in self._robot if self._scene.geometryObjects[b].parentJoint - near >= 3]
        self._scene.removeAllCollisionPairs()
        for a, b in pairs:
            self._scene.addCollisionPair(pin.CollisionPair(a, b))
        self._pairs = pairs

    def _arrange(self, standing: Mapping[int, Standing], held: Held | None, reached_for: int | None) -> None:
        """Put every object where it is, and choose the pairs that are checked."""
        for index, where in standing.items():
            centre = np.array([*where.xy, self._bodies[index].height_m / 2 + self._drop])
            rotation = pin.utils.rotate("z", where.yaw_rad)
            self._scene.geometryObjects[self._standing[index]].placement = pin.SE3(rotation, centre)
        if held is not None:
            self._scene.geometryObjects[self._carried[held.body]].placement = self._in_hand(held)
        here = {self._standing[i] for i in standing if held is None or i != held.body}
        carried = None if held is None else self._carried[held.body]
        for index, (a, b) in enumerate(self._pairs):
            carried_pair = a in self._carried
            active = (not carried_pair or a == carried) and (b not in self._standing or b in here)
            if not active:
                self._data.deactivateCollisionPair(index)
                continue
            self._data.activateCollisionPair(index)
            self._data.collisionRequests[index].security_margin = self._margin(a, b, reached_for)

    def _margin(self, a: int, b: int, reached_for: int | None) -> float:
        if reached_for is not None and b == self._standing[reached_for]:
            return _GRASP_MARGIN_M
        if b == self._table:
            return 0.0 if a in self._carried else _TABLE_MARGIN_M
        return self._kin.arm.clearance_m if b in self._standing else 0.0

    def _hits(self) -> list[tuple[int, int]]:
        """The pairs that the last check found in contact."""
        active, results = self._data.activeCollisionPairs, self._data.collisionResults
        return [p for k, p in enumerate(self._pairs) if active[k] and results[k].isCollision()]

    def _name_contact(self) -> Contact:
        a, b = self._hits()[0]
        body = self._standing.index(b) if b in self._standing else None
        return Contact(self._words(a), self._words(b), body)

    def _words(self, index: int) -> str:
        item = self._scene.geometryObjects[index]
        if index in self._robot:
            link = self._model.frames[item.parentFrame].name
            return self._kin.arm.model.parts.get(link, link)
        return "carried object" if index in self._carried else str(item.name)


def _solid(body: Body) -> coal.CollisionGeometry:
    if body.shape == "cylinder":
        return coal.Cylinder(body.half_width_m, body.height_m)
    return coal.Box(2 * body.half_width_m, 2 * body.half_width_m, body.height_m)
