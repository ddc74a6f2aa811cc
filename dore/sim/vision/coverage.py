"""Which cells a frame has measured: where an object of the smallest size could stand unseen, a cell is not known."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dore.sim.camera_config import CameraConfig
from dore.sim.frames import Array, pixels_of
from dore.sim.vision.perception import Frame, detections
from dore.sim.vision.scene_estimate import Detection, Observation, cell_of
from dore.world.layout import Layout

_STEP_M = 0.01
"""Between two places in a cell where an object's middle is tried."""
_BEYOND_M = 0.012
"""What is measured this far behind a point has been seen through it; depth noise is smaller."""
_RINGS = ((0.2, 6), (0.4, 8), (0.6, 12), (0.7, 20), (0.8, 32))
"""Where a top face is looked at, beside its middle: (share of the radius, how many points); noise blurs its edge."""
_FEWEST_SEEN = 5
"""So many of the 79 points seen through show that no object is there. Where one stands, noise shows 2 at most: 700
looks at cast rays."""


def observation(frame: Frame, layout: Layout, config: CameraConfig) -> Observation:
    """The objects in a frame, and the cells that it does not measure.

    Raises:
        NotUnderstood: no table is seen.
    """
    found = detections(frame, layout, config)
    return Observation(found, unmeasured(frame, layout, config, found))


def unmeasured(frame: Frame, layout: Layout, config: CameraConfig, found: Sequence[Detection]) -> frozenset[int]:
    """The cells, from 0, that hold no detected object, and of which the frame does not show that they are empty.

    An object of `config.smallest_m` would hide what is behind its top face. So it cannot stand where the camera has
    measured something behind that face; nor where it would stand inside of another one. What has no depth, what is
    hidden behind something, and what is cut by the frame shows nothing.
    """
    half_width, height = config.smallest_m
    taken = {cell_of(one, layout) for one in found}
    free = [cell for cell in range(layout.n_cells) if cell not in taken]
    if not free:
        return frozenset()
    places, cells = _middles(layout, np.array(free), config)
    apart = np.ones(len(places), dtype=bool)
    for one in found:
        apart &= np.linalg.norm(places - one.xy, axis=1) >= one.half_width_m + half_width
    places, cells = places[apart], cells[apart]
    top = places[:, None] + _disc(half_width)
    points = np.concatenate([top, np.full((*top.shape[:2], 1), height)], axis=2)
    hidden = _seen_through(frame, points).sum(1) < _FEWEST_SEEN
    return frozenset(cells[hidden].tolist())


def _middles(layout: Layout, free: NDArray[np.int64], config: CameraConfig) -> tuple[Array, NDArray[np.int64]]:
    """Float64[N, 2]: where the middle of an object may be in these cells, metres; Int64[N]: in which."""
    reach = max(0.0, layout.cell_m / 2 - config.edge_m)
    steps = np.linspace(-reach, reach, 2 * math.ceil(reach / _STEP_M) + 1)
    offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    places = layout.centres.numpy()[free][:, None] + offsets
    return places.reshape(-1, 2), np.repeat(free, len(offsets))


def _disc(radius: float) -> Array:
    """Float64[79, 2]: points all over a disc: its middle and rings."""
    angles = [(share, math.tau * k / n) for share, n in _RINGS for k in range(n)]
    return np.array([(0.0, 0.0)] + [(radius * r * math.cos(a), radius * r * math.sin(a)) for r, a in angles])


def _seen_through(frame: Frame, points: Array) -> NDArray[np.bool_]:
    """Bool[...]: whether something behind the points Float64[..., 3] was measured through them."""
    height, width = frame.depth_m.shape
    pixels, depth = pixels_of(points, frame.intrinsic, frame.camera_to_world)
    column, row = np.moveaxis(np.floor(pixels).astype(np.int64), -1, 0)
    inside = (depth > 0) & (column >= 0) & (column < width) & (row >= 0) & (row < height)
    measured = frame.depth_m[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)]
    return np.asarray(inside & (measured > depth + _BEYOND_M))
