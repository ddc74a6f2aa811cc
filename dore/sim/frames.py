"""Cells and metres: where a hand must be to enter a cell along an approach corridor. NumPy only.

World frame: REP-103 at the robot base's axis, +x away from the robot, +y to its left; z = 0 is the table top.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
TABLE_OVERHANG_M = 0.03
"""How far the table top stands out from the grid, towards the robot; metres."""


@dataclass(frozen=True)
class Corridor:
    """A straight approach into a cell, from a staging line in front of the grid.

    cell_xy: (x, y) where it ends, metres.
    staging_xy: (x, y) where it begins, metres.
    heading_rad: the hand's yaw on it, world frame, +x = 0, counter-clockwise.
    """

    cell_xy: tuple[float, float]
    staging_xy: tuple[float, float]
    heading_rad: float


def corridor(cell_xy: tuple[float, float], direction_deg: float, staging_x: float) -> Corridor:
    """The approach corridor of a cell for a direction.

    direction_deg: degrees, counter-clockwise, about the direction from the cell to the robot base (0: the arm
        reaches straight out to the cell).
    staging_x: x of the staging line, metres.

    Raises:
        ValueError: it never meets the staging line in front of the cell.
    """
    x, y = cell_xy
    heading = math.remainder(math.atan2(y, x) + math.radians(direction_deg), math.tau)
    if staging_x >= x or abs(heading) >= math.pi / 2 - 1e-6:
        raise ValueError(
            f"corridor into ({x:.3f}, {y:.3f}) heading {math.degrees(heading):.1f} deg does not come from the staging "
            f"line x = {staging_x:.3f} m"
        )
    staging = (staging_x, y - (x - staging_x) * math.tan(heading))
    return Corridor((x, y), staging, heading)


def hand_pose(xyz: Array, heading_rad: float, tilt_rad: float) -> Array:
    """Float64[4, 4]: pose of the tool frame (z forward, y across the jaws) at a point of the world.

    xyz: Float64[3], metres. tilt_rad: how far below the horizontal the hand points.
    """
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    ct, st = math.cos(tilt_rad), math.sin(tilt_rad)
    forward = np.array([ct * c, ct * s, -st])
    across = np.array([s, -c, 0.0])
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([np.cross(across, forward), across, forward])
    pose[:3, 3] = xyz
    return pose


def turned(xy: Array, angle_rad: float) -> Array:
    """Float64[2]: a vector turned counter-clockwise."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([c * xy[0] - s * xy[1], s * xy[0] + c * xy[1]])


def pixels_of(points: Array, intrinsic: Array, camera_to_world: Array) -> tuple[Array, Array]:
    """Where a camera sees points of the world Float64[..., 3]: columns and rows Float64[..., 2], depths Float64[...].

    What is not ahead of it, depth <= 0, is at no pixel.
    """
    seen = (points - camera_to_world[:3, 3]) @ camera_to_world[:3, :3] @ intrinsic.T
    return seen[..., :2] / np.maximum(seen[..., 2:], 1e-9), seen[..., 2]


def sight_lines(intrinsic: Array, shape: tuple[int, ...]) -> Array:
    """Float64[H, W, 3]: the direction in which each pixel's middle looks, in the camera's frame, z = 1."""
    height, width = shape
    pixel = np.stack(np.broadcast_arrays(np.arange(width) + 0.5, np.arange(height)[:, None] + 0.5, 1.0), axis=-1)
    return np.asarray(pixel @ np.linalg.inv(intrinsic).T)


def inside(centres: Array, cell_m: float, xy: Array) -> NDArray[np.bool_]:
    """Bool[G]: which cells (squares of `cell_m` about `centres` Float64[G, 2]) hold the point `xy` Float64[2]."""
    return np.asarray((np.abs(centres - xy) <= cell_m / 2).all(axis=-1))
