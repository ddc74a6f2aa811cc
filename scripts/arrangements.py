"""Random arrangements of objects for measuring what the camera sees, and the environment that they stand in."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import gymnasium as gym
import numpy as np
import sapien

from dore.sim.camera_config import CameraConfig
from dore.sim.config import Body, preset
from dore.sim.frames import Array
from dore.sim.scene.agent import render_backend
from dore.world.layout import Layout
from dore.world.problem import Scene

OBSTACLES = (3, 10)
JITTER_M = 0.01
_TALL_M = 0.20


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


def with_small_one(placed: Arrangement, camera: CameraConfig, rng: np.random.Generator) -> Arrangement:
    """One more object, of the smallest size, anywhere in an empty cell before a taken one, whose object is tall."""
    half_width, height = camera.smallest_m
    bodies = [replace(body, height_m=float(rng.uniform(body.height_m, _TALL_M))) for body in placed.bodies]
    free = [cell for cell in range(placed.layout.n_cells) if cell not in placed.cells]
    behind = [cell for cell in free if cell + placed.layout.grid_shape[1] in placed.cells] or free
    reach = placed.layout.cell_m / 2 - camera.edge_m
    room = [body.radius_m + math.sqrt(2) * half_width for body in bodies]
    for _ in range(1000):
        cell, offset = int(rng.choice(behind)), np.array([rng.uniform(0, reach), rng.uniform(-reach, reach)])
        if (np.linalg.norm(placed.xy - placed.layout.centres.numpy()[cell] - offset, axis=1) > room).all():
            break
    else:
        raise RuntimeError("no room for a small object")
    small = Body(("cuboid", "cylinder")[int(rng.integers(2))], half_width, height)
    return Arrangement(
        placed.layout, (*bodies, small), (*placed.cells, cell),
        np.vstack([placed.offsets_m, offset]), np.append(placed.yaws_rad, rng.uniform(0, math.pi / 2)),
    )  # fmt: skip
