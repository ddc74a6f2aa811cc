"""Random scenes for the camera, and how far what it says is from the truth."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
import sapien

import dore.sim.scene.task  # noqa: F401  (registers the environment)
from dore.sim.config import Body, preset
from dore.sim.motion.frames import Array
from dore.sim.scene.agent import render_backend
from dore.sim.vision.camera_config import CameraConfig
from dore.sim.vision.scene_estimate import Detection, NotUnderstood, Why, cell_of, estimate
from dore.world.layout import Layout
from dore.world.problem import Scene

OBSTACLES = (3, 10)
JITTER_M = 0.01
_FOUND_WITHIN_M = 0.03


@dataclass(frozen=True)
class Arrangement:
    """What stands where, the target first: cells from 0, offsets Float64[N, 2] in metres, yaws Float64[N]."""

    layout: Layout
    bodies: tuple[Body, ...]
    cells: tuple[int, ...]
    offsets_m: Array
    yaws_rad: Array

    @property
    def scene(self) -> Scene:
        """What the camera should say."""
        return Scene(self.layout, tuple(sorted(self.cells[1:])), self.cells[0])

    @property
    def xy(self) -> Array:
        """Float64[N, 2]: where each object stands, metres."""
        return np.asarray(self.layout.centres.numpy()[list(self.cells)] + self.offsets_m)


def random_arrangement(layout: Layout, rng: np.random.Generator, most: int = OBSTACLES[1]) -> Arrangement:
    """Objects in random cells, up to a centimetre from the middle, turned at random; the target of either shape."""
    count = 1 + int(rng.integers(OBSTACLES[0], most + 1))
    first = int(rng.integers(2))
    bodies = preset("objects/mixed").draw(count + 1, rng)[first : first + count]
    angle, radius = rng.uniform(0, math.tau, count), JITTER_M * np.sqrt(rng.uniform(0, 1, count))
    offsets = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    cells = tuple(map(int, rng.permutation(layout.n_cells)[:count]))
    return Arrangement(layout, bodies, cells, offsets, rng.uniform(0, math.pi / 2, count))


@contextmanager
def standing(placed: Arrangement, camera: CameraConfig) -> Iterator[Any]:
    """The environment with objects placed in it and the arm ready."""
    env = gym.make(
        "DoreTabletop-v1", layout=placed.layout, bodies=placed.bodies, camera=camera, obs_mode="none",
        reward_mode="none", control_mode="pd_joint_pos", sim_backend="physx_cpu", render_backend=render_backend(),
    )  # fmt: skip
    try:
        env.reset(seed=0, options={"cells": placed.cells, "offsets_m": placed.offsets_m, "yaws_rad": placed.yaws_rad})
        yield env
    finally:
        env.close()


def lay_down(env: Any, placed: Arrangement, rng: np.random.Generator) -> bool:
    """Lay one object down in the middle of where it stands, where it touches no other; False if none has room."""
    for body in rng.permutation(len(placed.bodies)).tolist():
        yaw = float(rng.uniform(0, math.pi))
        half, along = placed.bodies[body].height_m / 2, np.array([math.cos(yaw), math.sin(yaw)])
        offset = np.delete(placed.xy, body, axis=0) - placed.xy[body]
        beside = offset - np.clip(offset @ along, -half, half)[:, None] * along
        room = placed.bodies[body].radius_m + max(one.radius_m for one in placed.bodies) + 0.01
        if np.linalg.norm(beside, axis=1).min() < room:
            continue
        tilt = np.array([math.cos(math.pi / 4), 0.0, math.sin(math.pi / 4), 0.0])
        turn = sapien.Pose(q=[math.cos(yaw / 2), 0, 0, math.sin(yaw / 2)])
        at = sapien.Pose(p=[*placed.xy[body], placed.bodies[body].half_width_m])
        env.unwrapped.objects[body].set_pose(at * turn * sapien.Pose(q=tilt))
        return True
    return False


def scene_row(placed: Arrangement, seen: tuple[Detection, ...]) -> dict[str, Any]:
    """Whether the whole scene, and the target, are right; wrong: why the scene was not understood.

    lying: whether that is because an object does not stand upright.
    """
    targets = [cell_of(one, placed.layout) for one in seen if one.is_target]
    row = {"exact": False, "target": targets == [placed.cells[0]], "wrong": "", "lying": False}
    try:
        return row | {"exact": estimate(seen, placed.layout).scene == placed.scene}
    except NotUnderstood as error:
        return row | {"wrong": str(error), "lying": error.why is Why.NOT_UPRIGHT}


def object_rows(placed: Arrangement, seen: tuple[Detection, ...]) -> Iterator[dict[str, Any]]:
    """A row an object: what is right, and errors in millimetres and degrees; None where it was not found."""
    cells = {cell_of(one, placed.layout) for one in seen}
    for body, cell, xy, yaw in zip(placed.bodies, placed.cells, placed.xy, placed.yaws_rad, strict=True):
        near = min(seen, key=lambda one, xy=xy: math.dist(one.xy, xy), default=None)
        found = near if near is not None and math.dist(near.xy, xy) <= _FOUND_WITHIN_M else None
        row = {"cell": cell in cells, "upright": False, "shape": False}
        row |= dict.fromkeys(("centre_mm", "height_mm", "width_mm", "yaw_deg"))
        if found is not None:
            row |= {"upright": found.upright, "shape": found.shape == body.shape}
            row["centre_mm"] = 1000 * math.dist(found.xy, xy)
            row["height_mm"] = 1000 * (found.height_m - body.height_m)
            row["width_mm"] = 1000 * (found.half_width_m - body.half_width_m)
            if body.shape == found.shape == "cuboid":
                row["yaw_deg"] = math.degrees(math.remainder(found.yaw_rad - float(yaw), math.pi / 2))
        yield row
