"""The arm's kinematics by Pinocchio: inverse kinematics on one joint branch, straight lines and their timing."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin

from dore.sim.config import ArmConfig
from dore.sim.frames import Array, hand_pose

POSITION_TOLERANCE_M = 2e-4
ROTATION_TOLERANCE_RAD = 1e-3
WAYPOINT_M = 0.01
"""Spacing of the points at which a straight line is solved, metres."""
WAYPOINT_RAD = np.radians(2.0)
LARGEST_STEP_RAD = 0.25
"""More than this between two neighbouring waypoints is a jump to another branch."""
_PEAK_SPEED = 1.875
"""Peak of the derivative of the quintic that rises from 0 to 1 in unit time, at rest at both ends."""


class Unreachable(Exception):
    """The arm cannot take a pose on its branch; the message says where (world frame) and why."""


@dataclass(frozen=True)
class Reached:
    """Where the arm is: joints Float64[J] (radians), hand point Float64[3] (metres), heading (radians)."""

    joints: Array
    xyz: Array
    heading_rad: float


class ArmKinematics:
    """Forward and inverse kinematics of an arm on its pedestal, its fingers open; J joints.

    World frame: z = 0 is the table top; the base stands `base_drop_m` below it, at the origin.

    Args:
        urdf: the arm's description (`dore.sim.urdf.arm_files`).
        arm: what it is, how it stands and how its hand is tilted.
    """

    def __init__(self, urdf: Path, arm: ArmConfig) -> None:
        self.arm = arm
        full = pin.buildModelFromUrdf(str(urdf))
        others = [i for i in range(1, full.njoints) if full.names[i] not in arm.model.joints]
        neutral = pin.neutral(full)
        for joint in others:
            neutral[full.joints[joint].idx_q] = arm.model.fingers[full.names[joint]][0]
        geometry = pin.buildGeomFromUrdf(full, str(urdf), pin.GeometryType.COLLISION)
        self.model, self.geometry = pin.buildReducedModel(full, geometry, others, neutral)
        for item in self.geometry.geometryObjects:
            if isinstance(item.geometry, coal.BVHModelBase):
                item.geometry.buildConvexHull(True, "Qt")  # as SAPIEN does with the same meshes
                item.geometry = item.geometry.convex
        self.data = self.model.createData()
        self._tool = self.model.getFrameId(arm.model.tool_link)
        self._free = np.array([i for i, name in enumerate(arm.model.joints) if name not in arm.model.held_joints])
        self.lower, self.upper = self.model.lowerPositionLimit, self.model.upperPositionLimit

    @property
    def hand_half_width_m(self) -> float:
        """How far the open hand stands out to either side of the grasp point, seen along its heading, metres."""
        grasp = self.model.frames[self._tool].placement
        reach = 0.0
        for item in self.geometry.geometryObjects:
            if self.model.frames[item.parentFrame].name in self.arm.model.hand_links:
                corners = _corners(item.geometry) * item.meshScale
                across = (grasp.inverse() * item.placement).homogeneous[1]
                reach = max(reach, float(np.abs(corners @ across[:3] + across[3]).max()))
        return reach

    @property
    def speed_limit(self) -> Array:
        """Float64[J]: the joints' speed limits from the URDF, rad/s."""
        return np.asarray(self.model.velocityLimit)

    def ready(self, staging_x: float) -> Reached:
        """The arm at the middle of the staging line, the hand straight ahead at grasp height.

        Raises:
            Unreachable: no joint angles put it there.
        """
        xyz = np.array([staging_x, 0.0, self.arm.grasp_height_m])
        return Reached(self.solve(xyz, 0.0, np.array(self.arm.model.ready_seed), tries=200), xyz, 0.0)

    def tool(self, joints: Array) -> Array:
        """Float64[4, 4]: the tool frame in the world, for joints Float64[J]."""
        pin.framesForwardKinematics(self.model, self.data, joints)
        pose = self.data.oMf[self._tool].homogeneous.copy()
        pose[2, 3] -= self.arm.base_drop_m
        return pose

    def reached(self, joints: Array) -> Reached:
        """Where the hand is for joints Float64[J]."""
        pose = self.tool(joints)
        return Reached(joints, pose[:3, 3], float(np.arctan2(pose[1, 2], pose[0, 2])))

    def solve(self, xyz: Array, heading_rad: float, start: Array, tries: int = 60) -> Array:
        """Float64[J]: joints that put the tool at a point of the world with a heading and the arm's tilt.

        Damped least squares from `start` with as many free joints as a pose has: the answer depends on the pose and
        the branch, and not on the way there.

        Raises:
            Unreachable: not reached within `tries` steps and the joint limits.
        """
        above_base = xyz + np.array([0.0, 0.0, self.arm.base_drop_m])
        target = pin.SE3(hand_pose(above_base, heading_rad, self.arm.tilt_rad))
        joints = np.clip(start, self.lower, self.upper)
        for _ in range(tries):
            error, jacobian = self._error(joints, target)
            near = np.linalg.norm(error[:3]) < POSITION_TOLERANCE_M
            if near and np.linalg.norm(error[3:]) < ROTATION_TOLERANCE_RAD:
                return joints
            step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 1e-5 * np.eye(6), error)
            step *= min(1.0, 0.3 / max(float(np.abs(step).max()), 1e-9))
            joints[self._free] += step
            joints = np.clip(joints, self.lower, self.upper)
        where = f"({xyz[0]:.3f}, {xyz[1]:.3f}, {xyz[2]:.3f}) m heading {np.degrees(heading_rad):.1f} deg"
        raise Unreachable(f"no joint angles put the hand at {where}")

    def line(self, start: Reached, xyz: Array, heading_rad: float) -> tuple[Array, Reached]:
        """Joints Float64[N, J] along the straight line from `start` to a point, the heading turning evenly.

        Raises:
            Unreachable: a point of the line cannot be reached, or only by jumping to another branch.
        """
        steps = np.linalg.norm(xyz - start.xyz) / WAYPOINT_M, abs(heading_rad - start.heading_rad) / WAYPOINT_RAD
        points, headings = (
            np.linspace(begin, end, max(1, math.ceil(max(steps))) + 1)[1:]
            for begin, end in ((start.xyz, xyz), (start.heading_rad, heading_rad))
        )
        path, joints = [], start.joints
        for point, heading in zip(points, headings, strict=True):
            reached = self.solve(point, float(heading), joints)
            if np.abs(reached - joints).max() > LARGEST_STEP_RAD:
                raise Unreachable(f"the arm would have to change its branch near ({point[0]:.3f}, {point[1]:.3f}) m")
            path.append(reached)
            joints = reached
        return np.array(path), Reached(joints, np.asarray(xyz, dtype=np.float64), heading_rad)

    def _error(self, joints: Array, target: pin.SE3) -> tuple[Array, Array]:
        """The tool's way to `target` as a twist Float64[6], and its Jacobian for the free joints
        Float64[6, 6], both in the tool frame."""
        pin.computeJointJacobians(self.model, self.data, joints)
        here = pin.updateFramePlacement(self.model, self.data, self._tool)
        error = pin.log6(here.actInv(target)).vector
        jacobian = pin.getFrameJacobian(self.model, self.data, self._tool, pin.ReferenceFrame.LOCAL)
        return error, jacobian[:, self._free]


def _corners(shape: coal.CollisionGeometry) -> Array:
    """Float64[K, 3]: points whose convex hull holds the shape."""
    if isinstance(shape, coal.ConvexBase):
        return np.array([shape.point(i) for i in range(shape.num_points)])
    shape.computeLocalAABB()
    low, high = shape.aabb_local.min_, shape.aabb_local.max_
    return np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T


def timed(
    path: Array, length_m: float, dt: float, hand_speed: float, joint_speed: Array, joint_acceleration: Array
) -> Array:
    """Joint commands Float64[T, D], every `dt` seconds, at rest at both ends; the last one is the path's end.

    Args:
        path: Float64[N, D], radians; N >= 2, the first row is where the arm is.
        length_m: what the hand travels, metres.
        hand_speed: its highest speed, m/s.
        joint_speed, joint_acceleration: Float64[D], limits in rad/s and rad/s^2.
    """
    seconds = max(_PEAK_SPEED * length_m / hand_speed, 2 * dt)
    while True:
        commands = _sample(path, seconds, dt)
        velocity = np.diff(commands, axis=0, prepend=path[:1]) / dt
        acceleration = np.diff(velocity, axis=0, prepend=np.zeros_like(path[:1])) / dt
        too_fast = max(
            float((np.abs(velocity) / joint_speed).max()),
            math.sqrt(float((np.abs(acceleration) / joint_acceleration).max())),
        )
        if too_fast <= 1.0:
            return commands
        seconds *= max(too_fast, 1.02)


def _sample(path: Array, seconds: float, dt: float) -> Array:
    """The path under a quintic time law, every `dt`."""
    steps = max(1, math.ceil(seconds / dt))
    t = np.arange(1, steps + 1) / steps
    along = t**3 * (10.0 - 15.0 * t + 6.0 * t**2)
    knots = np.linspace(0.0, 1.0, len(path))
    return np.column_stack([np.interp(along, knots, joint) for joint in path.T])
