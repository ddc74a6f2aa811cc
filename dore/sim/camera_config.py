"""The settings of the RGB-D camera and of what is read from its pictures. See conf/camera/kinect.yaml."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from scipy.spatial.transform import Rotation

from dore.errors import InputError, number, whole
from dore.sim.checks import check_picture, number_list
from dore.sim.frames import Array, pixels_of
from dore.world.layout import Layout

Noise = Literal["kinect", "none"]
TargetBy = Literal["colour", "segmentation"]


@dataclass(frozen=True)
class CameraConfig:
    """A fixed RGB-D camera over the board, and how objects are found in its pictures.

    Positions are relative to the middle of the cells at the height of the table top, so that they suit any layout.

    Raises:
        InputError: a value that is not finite, unknown, or out of bounds.
    """

    position_m: tuple[float, float, float]
    look_at_m: tuple[float, float, float]
    width_px: int
    height_px: int
    field_of_view_deg: float
    noise: Noise
    target_by: TargetBy
    target_hue_deg: tuple[float, float]
    target_saturation: float
    front_margin_m: float
    margin_m: float
    lowest_m: float
    tallest_m: float
    widest_m: float
    patch_m: float
    fewest_patches: int
    smallest_m: tuple[float, float]
    edge_m: float
    pose_error_m: float
    pose_error_deg: float

    def __post_init__(self) -> None:
        for name, known in (("noise", get_args(Noise)), ("target_by", get_args(TargetBy))):
            if getattr(self, name) not in known:
                raise InputError(f"camera.{name}: got {getattr(self, name)!r}, want one of {', '.join(known)}")
        check_picture("camera", self.width_px, self.height_px, self.field_of_view_deg)
        whole("camera.fewest_patches", self.fewest_patches, 1, at_most=10_000)
        number("camera.target_saturation", self.target_saturation, above=0.0, at_most=1.0)
        for name in ("lowest_m", "tallest_m", "widest_m", "patch_m", "front_margin_m", "margin_m"):
            number(f"camera.{name}", getattr(self, name), above=0.0, at_most=1.0)
        if self.tallest_m <= self.lowest_m:
            raise InputError(
                f"camera.tallest_m: got {self.tallest_m:g}, want more than camera.lowest_m {self.lowest_m:g}"
            )
        self._check_lists()

    def _check_lists(self) -> None:
        for name, most in (("edge_m", 0.5), ("pose_error_m", 0.5), ("pose_error_deg", 45.0)):
            number(f"camera.{name}", getattr(self, name), above=-1e-12, at_most=most)
        xyz = ("x", "y", "z")
        pairs = {"target_hue_deg": ("low", "high"), "smallest_m": ("half width", "height")}
        for name, wanted in {"position_m": xyz, "look_at_m": xyz, **pairs}.items():
            number_list(f"camera.{name}", getattr(self, name), wanted, most=1000.0)
        low, high = self.target_hue_deg
        if not 0 <= low < high <= 360:
            raise InputError(f"camera.target_hue_deg: got [{low:g}, {high:g}], want 0 <= low < high <= 360")
        if math.dist(self.position_m[:2], self.look_at_m[:2]) < 1e-3:
            raise InputError(
                "camera.position_m: straight above camera.look_at_m, want it a little aside: which way is up?"
            )

    @property
    def intrinsic(self) -> Array:
        """Float64[3, 3], pixels; pixel (0, 0) has its middle at (0.5, 0.5)."""
        focal = self.height_px / 2 / math.tan(math.radians(self.field_of_view_deg) / 2)
        return np.array([[focal, 0, self.width_px / 2], [0, focal, self.height_px / 2], [0, 0, 1.0]])

    def pose(self, layout: Layout) -> Array:
        """Float64[4, 4]: camera to world, metres; the camera's x is right in the picture, y down, z ahead."""
        middle = np.append(layout.centres.mean(0).numpy(), 0.0)
        here, aim = middle + self.position_m, middle + self.look_at_m
        ahead = (aim - here) / np.linalg.norm(aim - here)
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3] = np.column_stack([right, np.cross(ahead, right), ahead, here])
        return pose

    def pose_error(self, rng: np.random.Generator) -> Array:
        """Float64[4, 4]: a drawn error, in the camera's own frame: it is taken to be at `pose @ error`."""
        error = np.eye(4)
        error[:3, :3] = Rotation.from_rotvec(rng.normal(0.0, self.pose_error_deg, 3), degrees=True).as_matrix()
        error[:3, 3] = rng.normal(0.0, self.pose_error_m, 3)
        return error

    def region(self, layout: Layout) -> tuple[Array, Array]:
        """Float64[2] each: the nearest and the farthest (x, y) that are searched, metres: the cells and margins."""
        centres, half = layout.centres.numpy(), layout.cell_m / 2
        near = centres.min(0) - half - [self.front_margin_m, self.margin_m]
        return near, centres.max(0) + half + self.margin_m

    def check_sees(self, layout: Layout) -> None:
        """Refuse a layout that does not fit into the picture.

        Raises:
            InputError: naming the first cell with a corner, on the table or `tallest_m` above it, outside the picture.
        """
        half = layout.cell_m / 2
        corners = np.array([[x, y, z] for x in (-half, half) for y in (-half, half) for z in (0.0, self.tallest_m)])
        pose = self.pose(layout)
        for cell, xy in enumerate(layout.cells, 1):
            pixel, depth = pixels_of(np.append(xy, 0.0) + corners, self.intrinsic, pose)
            if (depth <= 0).any() or (pixel < 0).any() or (pixel > [self.width_px, self.height_px]).any():
                raise InputError(
                    f"camera.position_m: cell {cell} is not all in the picture; want the camera higher, or turned"
                )
