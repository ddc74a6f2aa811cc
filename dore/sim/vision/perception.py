"""From one RGB-D frame to the objects on the table: points, table plane, clusters, shapes. NumPy and SciPy only."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from dore.sim.camera_config import CameraConfig
from dore.sim.frames import Array, sight_lines
from dore.sim.vision.scene_estimate import Detection, NotUnderstood, Shape, Why
from dore.world.layout import Layout

TARGET_SEGMENT = 1
"""In `Frame.segmentation`."""
# The table plane is fitted by least squares three times, each time to what lies this near the last fit, metres.
_TABLE_WITHIN_M = (0.04, 0.02, 0.01)
_FEWEST_TABLE_POINTS = 200
_ARM_BACK_M = 0.25
"""The search begins this far before the board, so that the arm is recognised by its height."""
_TOP_BAND_M = 0.015
"""The top's height is the median of what lies within this below the highest points."""
_FACE_BELOW_M = 0.001
"""Points further below the top than this are not taken for its face: they may be on a side wall."""
_SQUARE_FROM = 0.2
"""Between the fourth moment's share for a disc, 0, and for a square, 3 / 7."""

_MIXED = (0.1, 0.9)
"""Between these shares of the target's colour a cluster is neither the target nor an obstacle."""
_LONGER = 1.35
"""A top face that is so much longer than wide is neither a square nor a disc."""
_LEANING_DEG, _FEWEST_OF_A_FACE = 6.0, 12
"""A steeper top face leans; fewer points than that do not tell."""


@dataclass(frozen=True)
class Frame:
    """One picture of a calibrated RGB-D camera.

    depth_m: Float[H, W], metres along the optical axis; 0 where nothing was measured.
    rgb: UInt8[H, W, 3].
    intrinsic: Float64[3, 3], pixels; pixel (0, 0) has its middle at (0.5, 0.5).
    camera_to_world: Float64[4, 4]; the camera's x is right in the picture, y down, z ahead.
    segmentation: Int[H, W], or None: 0 where no object is, 1 the target, then the other objects.
    """

    depth_m: Array
    rgb: NDArray[np.uint8]
    intrinsic: Array
    camera_to_world: Array
    segmentation: NDArray[np.int64] | None = None


@dataclass(frozen=True)
class _Points:
    """What a part of the frame shows, point by point: xy Float64[N, 2] and height Float64[N] above the table, metres;
    target Bool[N]: looks like the target; border Bool[N]: at the border of the picture; camera Float64[3]: where the
    camera is."""

    xy: Array
    height: Array
    target: NDArray[np.bool_]
    border: NDArray[np.bool_]
    camera: Array

    def __getitem__(self, which: NDArray[np.bool_]) -> _Points:
        return _Points(self.xy[which], self.height[which], self.target[which], self.border[which], self.camera)

    def at_height(self, height: float) -> Array:
        """Float64[N, 2]: where their lines of sight are at another height, metres: depth noise moves points on them."""
        share = (self.camera[2] - height) / (self.camera[2] - self.height)
        return np.asarray(self.camera[:2] + share[:, None] * (self.xy - self.camera[:2]))


def detections(frame: Frame, layout: Layout, config: CameraConfig) -> tuple[Detection, ...]:
    """The objects on the table, near rows first, each from the robot's left to its right.

    What is too small to be an object is left out, and so is the arm: what reaches higher than an object, and what is
    nearer than the table. Where the arm is over the board, it is reported as an object that is not upright, since it
    may hide one.

    Raises:
        NotUnderstood: no table is seen.
    """
    points, near = _above_table(frame, layout, config), config.region(layout)[0]
    found = []
    for members in _clusters(points.xy, config):
        cluster = points[members]
        arm = bool(np.percentile(cluster.height, 98) > config.tallest_m)
        if arm:
            cluster = cluster[cluster.xy[:, 0] > layout.front_m]
            if len(np.unique(_patches(cluster.xy, config.patch_m), axis=0)) < config.fewest_patches:
                continue
        one = _detection(cluster, config, clear=not arm)
        if one.xy[0] >= near[0]:
            found.append(one)
    return tuple(sorted(found, key=lambda one: (one.xy[0], -one.xy[1])))


def world_points(frame: Frame) -> Array:
    """Float64[H, W, 3]: where each pixel's point is, metres; meaningless where no depth was measured."""
    pose, lines = frame.camera_to_world, sight_lines(frame.intrinsic, frame.depth_m.shape)
    return np.asarray(lines * frame.depth_m[..., None] @ pose[:3, :3].T + pose[:3, 3])


def _above_table(frame: Frame, layout: Layout, config: CameraConfig) -> _Points:
    """The points of the searched region, and before it, that are not table.

    Raises:
        NotUnderstood: no table is seen.
    """
    points, (near, far) = world_points(frame), config.region(layout)
    near = near - [_ARM_BACK_M, 0.0]
    inside = (frame.depth_m > 0) & ((points[..., :2] >= near) & (points[..., :2] <= far)).all(-1)
    points = points[inside]
    height = points[:, 2] - _table_height(points)
    target, camera = _looks_like_target(frame, inside, config), frame.camera_to_world[:3, 3]
    border = np.ones(frame.depth_m.shape, dtype=bool)
    border[2:-2, 2:-2] = False
    return _Points(points[:, :2], height, target, border[inside], camera)[height > config.lowest_m]


def _table_height(points: Array) -> Array:
    """Float64[N]: the table's z below each of the points Float64[N, 3], metres.

    The camera's calibration puts it at 0; least squares on what lies near corrects a few millimetres and degrees.

    Raises:
        NotUnderstood: too few points lie near it.
    """
    basis = np.column_stack([points[:, :2], np.ones(len(points))])
    plane = np.zeros(3)
    for within in _TABLE_WITHIN_M:
        near = np.abs(points[:, 2] - basis @ plane) < within
        if near.sum() < _FEWEST_TABLE_POINTS:
            raise NotUnderstood(Why.NO_TABLE, "no table is seen where the board should be")
        rows = basis[near]
        plane = np.linalg.solve(rows.T @ rows, rows.T @ points[near, 2])
    return np.asarray(basis @ plane)


def _looks_like_target(frame: Frame, which: NDArray[np.bool_], config: CameraConfig) -> NDArray[np.bool_]:
    """Bool[N]: of the chosen pixels, by colour or by segment."""
    if config.target_by == "segmentation":
        if frame.segmentation is None:
            raise ValueError("camera.target_by is segmentation, and the frame has none")
        return np.asarray(frame.segmentation[which] == TARGET_SEGMENT)
    colour = frame.rgb[which].astype(np.float64)
    red, green, blue = colour.T
    hue_deg = np.degrees(np.arctan2(math.sqrt(3) * (green - blue), 2 * red - green - blue)) % 360
    saturation = 1.0 - colour.min(1) / np.maximum(colour.max(1), 1.0)
    low, high = config.target_hue_deg
    return np.asarray((hue_deg >= low) & (hue_deg <= high) & (saturation >= config.target_saturation))


def _patches(xy: Array, edge_m: float) -> NDArray[np.int64]:
    """Int64[N, 2]: the square of a grid that each point lies in."""
    return np.asarray(np.floor(xy / edge_m).astype(np.int64))


def _clusters(xy: Array, config: CameraConfig) -> list[NDArray[np.bool_]]:
    """Bool[N] for each group of touching squares, seen from above, that is large enough; a square needs two points."""
    if len(xy) == 0:
        return []
    patch = _patches(xy, config.patch_m)
    row, column = (patch - patch.min(0)).T
    count = np.zeros((row.max() + 1, column.max() + 1), dtype=np.int64)
    np.add.at(count, (row, column), 1)
    label, n_labels = ndimage.label(count >= 2, structure=np.ones((3, 3)))
    size = np.bincount(label.ravel(), minlength=n_labels + 1)
    of_point = label[row, column]
    return [of_point == k for k in range(1, n_labels + 1) if size[k] >= config.fewest_patches]


def _detection(points: _Points, config: CameraConfig, clear: bool) -> Detection:
    """The object that a cluster shows. clear: it is an object of its own; if not, it never counts as upright."""
    level = np.percentile(points.height, 98)
    height = float(np.median(points.height[points.height > level - _TOP_BAND_M]))
    is_target = bool(points.target.mean() > 0.5)
    length = _length(points.xy)
    if not clear or length > min(config.widest_m, height):
        x, y = points.xy.mean(0).tolist()
        return Detection((x, y), length / 2, height, 0.0, "cuboid", upright=False, is_target=is_target)
    face = points[points.height > height - _FACE_BELOW_M].at_height(height)
    weight = _evenly(face, config.patch_m)
    xy, half_width, yaw, shape = _footprint(face, weight)
    doubt = _doubt(points, height, face, weight)
    return Detection(xy, half_width, height, yaw, shape, upright=True, is_target=is_target, doubt=doubt)


def _doubt(points: _Points, height: float, face: Array, weight: Array) -> str:
    """Why a cluster is not one whole object; empty: nothing speaks against it.

    face: Float64[N, 2], points of the top face; weight: Float64[N], of each.
    """
    if points.border.any():
        return "the picture's border cuts it"
    share = float(points.target.mean())
    if _MIXED[0] < share < _MIXED[1]:
        return f"the target's colour is on {100 * share:.0f} % of it, so it is two, stacked or touching"
    spread = np.linalg.eigvalsh(np.cov(face.T, aweights=weight))
    if spread[1] > _LONGER**2 * spread[0]:
        return f"its top is {math.sqrt(spread[1] / spread[0]):.1f} times as long as wide, so it is two, or half hidden"
    leaning = _slope_deg(points[points.height > height - _TOP_BAND_M], face)
    return f"it leans by {leaning:.0f} degrees" if leaning > _LEANING_DEG else ""


def _slope_deg(top: _Points, face: Array) -> float:
    """The slope of a top face, degrees: of a plane through the points over the middle half of it."""
    middle = face.mean(0)
    near = np.linalg.norm(top.xy - middle, axis=1) < np.median(np.linalg.norm(face - middle, axis=1))
    if near.sum() < _FEWEST_OF_A_FACE:
        return 0.0
    basis = np.column_stack([top.xy[near] - middle, np.ones(near.sum())])
    slope = np.linalg.lstsq(basis, top.height[near], rcond=None)[0][:2]
    return math.degrees(math.atan(float(np.linalg.norm(slope))))


def _length(xy: Array) -> float:
    """How far a cluster reaches along its longer axis, metres; a few stray points do not count."""
    _, axes = np.linalg.eigh(np.cov(xy.T))
    low, high = np.percentile((xy - xy.mean(0)) @ axes[:, 1], (0.5, 99.5))
    return float(high - low)


def _evenly(xy: Array, edge_m: float) -> Array:
    """Float64[N]: the weight of each point, so that no square weighs more than the median one.

    The sides of an object are seen as crowds of points along an edge of its top face.
    """
    _, which, count = np.unique(_patches(xy, edge_m), axis=0, return_inverse=True, return_counts=True)
    return np.asarray(np.minimum(1.0, np.median(count) / count)[which.ravel()])


def _footprint(xy: Array, weight: Array) -> tuple[tuple[float, float], float, float, Shape]:
    """Middle, half width, yaw and shape of the top face that the points Float64[N, 2] cover evenly, by its moments.

    About its middle a disc's E[(x + iy)^4] is 0. A square's is not, and its angle is four times the yaw plus pi.
    """
    weight = weight / weight.sum()
    middle = weight @ xy
    offset = (xy - middle) @ [1.0, 1.0j]
    fourth, square = weight @ offset**4, float(weight @ np.abs(offset) ** 2)
    x, y = middle.tolist()
    if np.abs(fourth) > _SQUARE_FROM * (weight @ np.abs(offset) ** 4):
        return (x, y), math.sqrt(1.5 * square), float(np.angle(-fourth)) / 4, "cuboid"
    return (x, y), math.sqrt(2.0 * square), 0.0, "cylinder"
