"""RGB-D frames without a renderer: rays cast at boxes and cylinders, so that vision is tested on any machine."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dore.sim.camera_config import CameraConfig
from dore.sim.frames import Array
from dore.sim.vision.perception import Frame
from dore.world.layout import Layout

GREEN, RED, TABLE, FLOOR = (74, 163, 106), (194, 124, 104), (214, 206, 190), (150, 152, 158)


@dataclass(frozen=True)
class Solid:
    """A box or a cylinder about its own z axis: half its size (a cylinder's radius twice), middle and rotation."""

    shape: str
    half: tuple[float, float, float]
    middle: tuple[float, float, float]
    rotation: Array
    colour: tuple[int, int, int] = RED


def standing(
    shape: str, xy: tuple[float, float], half_width: float = 0.025, height: float = 0.145, yaw: float = 0.0,
    bottom: float = 0.0, colour: tuple[int, int, int] = RED,
) -> Solid:  # fmt: skip
    """An upright object on the table, or hanging over it."""
    half, middle = (half_width, half_width, height / 2), (*xy, bottom + height / 2)
    return Solid(shape, half, middle, _about_z(yaw), colour)


def lying(shape: str, xy: tuple[float, float], yaw: float = 0.0) -> Solid:
    """The same, laid down."""
    down = np.array([[0, 0, 1.0], [0, 1.0, 0], [-1.0, 0, 0]])
    return Solid(shape, (0.025, 0.025, 0.0725), (*xy, 0.025), _about_z(yaw) @ down)


def picture(config: CameraConfig, layout: Layout, solids: Sequence[Solid], pose: Array | None = None) -> Frame:
    """What a perfect camera at `pose` shows; None: where it should be, which is what the frame says in any case."""
    where = config.pose(layout)
    pose = where if pose is None else pose
    k = config.intrinsic
    x = (np.arange(config.width_px) + 0.5 - k[0, 2]) / k[0, 0]
    y = (np.arange(config.height_px)[:, None] + 0.5 - k[1, 2]) / k[1, 1]
    # A direction's share along the optical axis is 1, so the way to a hit is its depth.
    rays = np.stack(np.broadcast_arrays(x, y, 1.0), axis=-1) @ pose[:3, :3].T
    depth, seen = _ground(pose[:3, 3], rays, layout)
    segments = np.zeros(depth.shape, dtype=np.int64)
    for index, solid in enumerate(solids, 1):
        hit = _hit(solid, pose[:3, 3], rays)
        nearer = hit < depth
        depth, segments = np.where(nearer, hit, depth), np.where(nearer, index, segments)
        seen = np.where(nearer[..., None], solid.colour, seen)
    return Frame(depth, seen.astype(np.uint8), k, where, segments)


def _about_z(yaw: float) -> Array:
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def _ground(camera: Array, rays: Array, layout: Layout) -> tuple[Array, Array]:
    """Depth and colour of the table and of the floor beside it."""
    centres, half = layout.centres.numpy(), layout.cell_m / 2
    near, far = centres.min(0) - half - [0.03, 0.15], centres.max(0) + half + [0.10, 0.15]
    on_table = -camera[2] / rays[..., 2]
    xy = camera[:2] + on_table[..., None] * rays[..., :2]
    table = ((xy >= near) & (xy <= far)).all(-1)
    return np.where(table, on_table, (-0.6 - camera[2]) / rays[..., 2]), np.where(table[..., None], TABLE, FLOOR)


def _hit(solid: Solid, camera: Array, rays: Array) -> Array:
    """Depth at which each ray meets a solid; infinite where it does not."""
    half, start, way = np.array(solid.half), (camera - solid.middle) @ solid.rotation, rays @ solid.rotation
    with np.errstate(divide="ignore", invalid="ignore"):
        sides = np.sort([(-half - start) / way, (half - start) / way], axis=0)
        if solid.shape == "cylinder":
            a, b = (way[..., :2] ** 2).sum(-1), way[..., :2] @ start[:2]
            root = np.sqrt(b**2 - a * (start[:2] @ start[:2] - half[0] ** 2))
            round_sides = np.stack([(-b - root) / a, (-b + root) / a])
            enter = np.maximum(round_sides[0], sides[0, ..., 2])
            leave = np.minimum(round_sides[1], sides[1, ..., 2])
        else:
            enter, leave = sides[0].max(-1), sides[1].min(-1)
        return np.where((enter < leave) & (enter > 0), enter, np.inf)
