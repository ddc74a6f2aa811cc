"""The arm's kinematics by Pinocchio: inverse kinematics on one joint branch, and straight lines in space."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from dore.sim.config import ArmConfig
from dore.sim.description import ARM_JOINTS, FINGER_OPEN_M, TOOL_LINK
from dore.sim.frames import Array, hand_pose, straight

POSITION_TOLERANCE_M = 2e-4
ROTATION_TOLERANCE_RAD = 1e-3
WAYPOINT_M = 0.01
"""Spacing of the points at which a straight line is solved, metres."""
WAYPOINT_RAD = np.radians(2.0)
LARGEST_STEP_RAD = 0.25
"""More than this between two neighbouring waypoints is a jump to another branch."""

# Elbow up, hand ahead: the branch that the search for the ready posture starts on.
_READY_SEED = np.array([0.0, -0.8, 0.0, -2.6, 0.0, 2.7, 0.785])
# Joint 3 stays at zero, so the elbow stays in the vertical plane through the wrist and the joints of a pose are
# unique. Drawing all joints to a home posture instead jumps between two elbows, or twists the elbow aside.
_FREE = np.array([0, 1, 3, 4, 5, 6])


class Unreachable(Exception):
    """The arm cannot take a pose on its branch; the message says where (world frame) and why."""


@dataclass(frozen=True)
class Reached:
    """Where the arm is: joints Float64[7] (radians), hand point Float64[3] (metres), heading (radians)."""

    joints: Array
    xyz: Array
    heading_rad: float


class ArmKinematics:
    """Forward and inverse kinematics of the slim-handed Panda on its pedestal.

    World frame: z = 0 is the table top; the base stands `base_drop_m` below it, at the origin.

    Args:
        urdf: the arm's description (`description.arm_files`).
        arm: how it stands and how its hand is tilted.
    """

    def __init__(self, urdf: Path, arm: ArmConfig) -> None:
        self.arm = arm
        full = pin.buildModelFromUrdf(str(urdf))
        fingers = [i for i in range(1, full.njoints) if full.names[i] not in ARM_JOINTS]
        neutral = pin.neutral(full)
        for joint in fingers:
            neutral[full.joints[joint].idx_q] = FINGER_OPEN_M
        geometry = pin.buildGeomFromUrdf(full, str(urdf), pin.GeometryType.COLLISION)
        self.model, self.geometry = pin.buildReducedModel(full, geometry, fingers, neutral)
        self.data = self.model.createData()
        self._tool = self.model.getFrameId(TOOL_LINK)
        self.lower, self.upper = self.model.lowerPositionLimit, self.model.upperPositionLimit

    @property
    def speed_limit(self) -> Array:
        """Float64[7]: the joints' speed limits from the URDF, rad/s."""
        return np.asarray(self.model.velocityLimit)

    def ready(self, staging_x: float) -> Reached:
        """The arm at the middle of the staging line, the hand straight ahead at grasp height.

        Raises:
            Unreachable: there is none.
        """
        xyz = np.array([staging_x, 0.0, self.arm.grasp_height_m])
        return Reached(self.solve(xyz, 0.0, _READY_SEED, tries=200), xyz, 0.0)

    def tool(self, joints: Array) -> Array:
        """Float64[4, 4]: the tool frame in the world, for joints Float64[7]."""
        pin.framesForwardKinematics(self.model, self.data, joints)
        pose = self.data.oMf[self._tool].homogeneous.copy()
        pose[2, 3] -= self.arm.base_drop_m
        return pose

    def solve(self, xyz: Array, heading_rad: float, start: Array, tries: int = 60) -> Array:
        """Float64[7]: joints that put the tool at a point of the world with a heading and the arm's tilt.

        Damped least squares from `start` with joint 3 held at zero: the answer depends on the pose and the branch,
        and not on the way there.

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
            joints[_FREE] += step
            joints = np.clip(joints, self.lower, self.upper)
        where = f"({xyz[0]:.3f}, {xyz[1]:.3f}, {xyz[2]:.3f}) m heading {np.degrees(heading_rad):.1f} deg"
        raise Unreachable(f"no joint angles put the hand at {where}")

    def line(self, start: Reached, xyz: Array, heading_rad: float) -> tuple[Array, Reached]:
        """Joints Float64[N, 7] along the straight line from `start` to a point, the heading turning evenly.

        Raises:
            Unreachable: a point of the line cannot be reached, or only by jumping to another branch.
        """
        points = straight(start.xyz, xyz, WAYPOINT_M)
        turns = int(np.ceil(abs(heading_rad - start.heading_rad) / WAYPOINT_RAD))
        if turns > len(points):
            points = start.xyz + np.linspace(0.0, 1.0, turns + 1)[1:, None] * (xyz - start.xyz)
        headings = np.linspace(start.heading_rad, heading_rad, len(points) + 1)[1:]
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
        return error, jacobian[:, _FREE]
