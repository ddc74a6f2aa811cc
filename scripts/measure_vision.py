"""How well the camera reads the board: random scenes in the simulator, with a real sensor's depth noise and without.

python -m scripts.measure_vision out=FOLDER [scenes=200] [lying=40] [seed=1] [camera=kinect] [picture=FILE]
Objects of both shapes and of random sizes stand up to a centimetre from the middle of their cells and turned at random;
the arm is ready. Then scenes in which one object lies, which must be reported. FOLDER/scenes, FOLDER/objects and
FOLDER/lying get a rows.csv each, and the picture the first noisy frame; `dore-report study=vision` makes the page.
Needs a Vulkan driver (scripts/install_lavapipe.sh); about five minutes on one core.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import sapien
from tqdm import trange

from dore.files import check_outputs
from dore.report.measurements import write_measurements
from dore.sim.camera_config import CameraConfig
from dore.sim.config import Body, preset
from dore.sim.frames import Array
from dore.sim.scene.agent import render_backend
from dore.sim.vision.camera import RgbdCamera, rendered
from dore.sim.vision.perception import detections
from dore.sim.vision.scene_estimate import Detection, NotUnderstood, Observation, Why, cell_of, estimate
from dore.world.layout import Layout
from dore.world.problem import Scene
from scripts.program import run
from scripts.vision_figure import draw

LAYOUT = Layout.grid(3, 6, 0.12, 0.50)
OBSTACLES = (3, 10)
JITTER_M = 0.01
_FOUND_WITHIN_M = 0.03
_FEW_OBSTACLES = 6
"""At most so many beside a lying object, so that there is room for it."""
Rows = list[dict[str, Any]]


@dataclass(frozen=True)
class Options:
    """out: the folder of the rows. scenes: with all objects upright. lying: scenes with one object lying down.

    seed: of scenes and noise; settings were chosen on seed 0. camera: one of conf/camera.
    """

    out: Path
    scenes: int = 200
    lying: int = 40
    seed: int = 1
    camera: str = "kinect"
    picture: Path = Path("docs/results/vision.png")


def main(options: Options) -> None:
    """Measure, and write the rows and the picture.

    Raises:
        InputError: nothing can render here.
    """
    camera: CameraConfig = preset(f"camera/{options.camera}")
    started = time.perf_counter()
    check_outputs(picture=options.picture)
    # A renderer compiles its shaders again once no other is left: this one stays.
    with standing(random_arrangement(LAYOUT, np.random.default_rng(options.seed)), camera) as env:
        rendered(env)
        scenes, objects = upright_scenes(camera, options.scenes, options.seed, options.picture)
        lying = lying_scenes(camera, options.lying, options.seed)
    about = {"seed": options.seed, "camera": options.camera, "rendering": render_backend()}
    about["seconds"] = f"{time.perf_counter() - started:.0f}"
    about["wrong"] = "; ".join(f"with noise={row['noise']}: {row['wrong']}" for row in scenes if row["wrong"])
    for name, rows in (("objects", objects), ("lying", lying), ("scenes", scenes)):
        write_measurements(options.out / name, rows, **about)


def upright_scenes(camera: CameraConfig, count: int, seed: int, picture: Path) -> tuple[Rows, Rows]:
    """A row a scene and a row an object, with noisy depth and with exact depth; draws the first noisy frame."""
    scenes: Rows = []
    objects: Rows = []
    for index in trange(count, desc="upright", file=sys.stderr):
        placed = random_arrangement(LAYOUT, np.random.default_rng([seed, 0, index]))
        with standing(placed, camera) as env:
            for noise in ("kinect", "none"):
                started = time.perf_counter()
                frame = RgbdCamera(env, seed=index).frame() if noise == "kinect" else rendered(env)
                taken = time.perf_counter()
                seen = detections(frame, LAYOUT, camera)
                times = {"frame_s": taken - started, "reading_s": time.perf_counter() - taken}
                which = {"noise": noise, "scene": index}
                scenes.append(which | scene_row(placed, seen) | times)
                objects += [which | row for row in object_rows(placed, seen)]
                if index == 0 and noise == "kinect":
                    draw(picture, frame, seen, placed)
    return scenes, objects


def lying_scenes(camera: CameraConfig, count: int, seed: int) -> Rows:
    """Whether a lying object was reported, scene by scene, with noise; scenes without room for one are left out."""
    found: Rows = []
    for index in trange(10 * count, desc="lying", total=count, file=sys.stderr):
        rng = np.random.default_rng([seed, 1, index])
        placed = random_arrangement(LAYOUT, rng, most=_FEW_OBSTACLES)
        with standing(placed, camera) as env:
            if lay_down(env, placed, rng):
                seen = RgbdCamera(env, seed=index).look().objects
                found.append({"scene": index, "reported": scene_row(placed, seen)["lying"]})
        if len(found) == count:
            return found
    raise RuntimeError(f"only {len(found)} of {count} scenes have room for a lying object")


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
        return row | {"exact": estimate(Observation(seen), placed.layout).scene == placed.scene}
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


if __name__ == "__main__":
    sys.exit(run(main, Options))
