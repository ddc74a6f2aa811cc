"""Depth as a Kinect would measure it, made from true depth by published noise models. NumPy only."""

from __future__ import annotations

import numpy as np

from dore.sim.frames import Array, sight_lines

NEAR_M, FAR_M = 0.4, 3.0
"""The range of a Kinect's near mode; it measures nothing outside it."""
GRAZING_RAD = np.radians(80.0)
"""A surface seen at a flatter angle gives no depth."""
INVERSE_DEPTH_STEP = 2.85e-3
"""One step of disparity as inverse depth, 1/m: 2.6 mm of depth at 0.95 m."""
BASELINE_M = 0.075
"""From the infrared camera to the projector on its right."""
_BROAD_RAD = np.radians(60.0)
_SHADOW_PX = 1.0


def kinect_depth(depth_m: Array, intrinsic: Array, rng: np.random.Generator) -> Array:
    """What a Kinect would measure.

    Lateral noise: a pixel measures what lies some pixels beside it, with a standard deviation of
    0.8 + 0.035 a / (pi/2 - a) pixels. Axial noise: 0.0012 + 0.0019 (z - 0.4)^2 metres, and where a is over 60 degrees
    0.0001 / sqrt(z) * a^2 / (pi/2 - a)^2 more; a is the angle between line of sight and surface normal (C. V. Nguyen,
    S. Izadi, D. Lovell: Modeling Kinect Sensor Noise for Improved 3D Reconstruction and Tracking, 3DIMPVT 2012).

    Then disparity in whole steps, and no depth where something keeps the projector's light away (K. Khoshelham,
    S. O. Elberink: Accuracy and Resolution of Kinect Depth Data for Indoor Mapping Applications, Sensors 12(2), 2012).
    Nguyen's measurements hold the steps already, so the sum errs on the noisy side. The cut at `GRAZING_RAD` is ours:
    Nguyen's fit has no bound towards 90 degrees.

    Args:
        depth_m: Float64[H, W], metres along the optical axis; 0 where there is nothing.
        intrinsic: Float64[3, 3], pixels.

    Returns:
        Float64[H, W], metres; 0 where nothing was measured.
    """
    there = depth_m > 0
    inverse = np.divide(1.0, depth_m, out=np.zeros_like(depth_m), where=there)
    angle = np.minimum(_viewing_angle(inverse, intrinsic), GRAZING_RAD)
    lost = ~there | (angle >= GRAZING_RAD) | _in_shadow(inverse, float(intrinsic[0, 0]))
    rows, columns = _beside(angle, rng)
    measured, angle, lost = depth_m[rows, columns], angle[rows, columns], lost | lost[rows, columns]
    measured = measured + rng.standard_normal(measured.shape) * _axial_sigma(measured, angle)
    lost |= ~((measured >= NEAR_M) & (measured <= FAR_M))
    steps = np.rint(1.0 / np.where(lost, 1.0, measured) / INVERSE_DEPTH_STEP)
    return np.where(lost, 0.0, 1.0 / (steps * INVERSE_DEPTH_STEP))


def _axial_sigma(z: Array, angle: Array) -> Array:
    """Float64[H, W], metres; depth 0 is taken as near."""
    z = np.maximum(z, NEAR_M)
    steep = np.where(angle > _BROAD_RAD, 1e-4 / np.sqrt(z) * (angle / (np.pi / 2 - angle)) ** 2, 0.0)
    return np.asarray(0.0012 + 0.0019 * (z - 0.4) ** 2 + steep)


def _beside(angle: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """The row and column that each pixel measures in place of its own."""
    sigma = 0.8 + 0.035 * angle / (np.pi / 2 - angle)
    shift = np.rint(rng.standard_normal((2, *angle.shape)) * sigma).astype(np.int64)
    rows, columns = np.indices(angle.shape) + shift
    return rows.clip(0, angle.shape[0] - 1), columns.clip(0, angle.shape[1] - 1)


def _viewing_angle(inverse: Array, intrinsic: Array) -> Array:
    """Float64[H, W]: radians between line of sight and surface normal; 0: the surface faces the camera.

    On a plane inverse depth is linear in the pixels, so its slopes give the normal.
    """
    lines = sight_lines(intrinsic, inverse.shape)
    across, down = intrinsic[0, 0] * _slope(inverse, 1), intrinsic[1, 1] * _slope(inverse, 0)
    ahead = inverse - lines[..., 0] * across - lines[..., 1] * down
    normal, sight = np.sqrt(across**2 + down**2 + ahead**2), np.linalg.norm(lines, axis=-1)
    return np.asarray(np.arccos(np.clip(inverse / np.maximum(normal * sight, 1e-12), 0.0, 1.0)))


def _slope(values: Array, axis: int) -> Array:
    """Change from pixel to pixel, on the side where it is smaller: the other may lie on another surface.

    Over two pixels, since rendered depth comes in whole millimetres.
    """
    ahead, back = (np.roll(values, -2, axis) - values) / 2, (values - np.roll(values, 2, axis)) / 2
    return np.where(np.abs(ahead) < np.abs(back), ahead, back)


def _in_shadow(inverse: Array, focal_px: float) -> Array:
    """Bool[H, W]: what the camera sees and the projector does not, since something nearer lies in its way.

    From left to right the projector meets what the camera sees in the same order, but for what it cannot see.
    """
    column = np.arange(inverse.shape[1]) - focal_px * BASELINE_M * inverse
    first_beyond = np.minimum.accumulate(column[:, ::-1], axis=1)[:, ::-1]
    return np.asarray(column > first_beyond + _SHADOW_PX)
