"""How well the camera reads the board: random scenes in the simulator, with a real sensor's depth noise and without.

python -m scripts.measure_vision out=FOLDER [scenes=200] [lying=40] [hidden=200] [seed=1] [camera=kinect] [picture=FILE]
Objects of both shapes and of random sizes stand up to a centimetre from the middle of their cells and turned at random;
the arm is ready. Then scenes in which one object lies, and others with a small one behind tall ones, which must be
reported. FOLDER/scenes, FOLDER/objects, FOLDER/lying and FOLDER/hidden get a rows.csv each, and the picture the first
noisy frame; `dore-report study=vision` makes the page. Needs a Vulkan driver (scripts/install_lavapipe.sh); about ten
minutes on one core.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import trange

from dore.files import check_outputs
from dore.report.measurements import write_measurements
from dore.sim.camera_config import CameraConfig
from dore.sim.config import preset
from dore.sim.scene.agent import render_backend
from dore.sim.vision.camera import RgbdCamera, rendered
from dore.sim.vision.coverage import observation
from dore.sim.vision.scene_estimate import Detection, NotUnderstood, Observation, Why, cell_of, estimate
from dore.world.layout import Layout
from scripts.arrangements import Arrangement, lay_down, random_arrangement, standing, with_small_one
from scripts.program import run
from scripts.vision_figure import draw

LAYOUT = Layout.grid(3, 6, 0.12, 0.50)
_FOUND_WITHIN_M = 0.03
_LOOKS = 3
"""As a closed loop has: limits.max_looks."""
_FEW_OBSTACLES = 6
"""At most so many beside a lying object, so that there is room for it."""
Rows = list[dict[str, Any]]


@dataclass(frozen=True)
class Options:
    """out: the folder of the rows. scenes: with all objects upright. lying: scenes with one object lying down.

    hidden: scenes with an object of the camera's smallest size, nearer the robot than objects up to 20 cm high.
    seed: of scenes and noise; settings were chosen on seed 0. camera: one of conf/camera.
    """

    out: Path
    scenes: int = 200
    lying: int = 40
    hidden: int = 200
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
        scenes, objects, first = upright_scenes(camera, options.scenes, options.seed)
        lying = lying_scenes(camera, options.lying, options.seed)
        hidden = hidden_scenes(camera, options.hidden, options.seed)
    about = {"seed": options.seed, "camera": options.camera, "rendering": render_backend()}
    about["seconds"] = f"{time.perf_counter() - started:.0f}"
    about["wrong"] = "; ".join(f"with noise={row['noise']}: {row['wrong']}" for row in scenes if row["wrong"])
    for name, rows in (("objects", objects), ("lying", lying), ("hidden", hidden), ("scenes", scenes)):
        write_measurements(options.out / name, rows, **about)
    draw(options.picture, *first)  # Last: a new picture in the checkout would make the rows those of a changed one.


def upright_scenes(camera: CameraConfig, count: int, seed: int) -> tuple[Rows, Rows, Any]:
    """A row a scene and a row an object, with noisy depth and with exact depth; and what `draw` takes, of the first
    noisy frame."""
    scenes: Rows = []
    objects: Rows = []
    first: Any = None
    for index in trange(count, desc="upright", file=sys.stderr):
        placed = random_arrangement(LAYOUT, np.random.default_rng([seed, 0, index]))
        with standing(placed, camera) as env:
            for noise in ("kinect", "none"):
                started = time.perf_counter()
                noisy = RgbdCamera(env, seed=index)
                frame = noisy.frame() if noise == "kinect" else rendered(env)
                taken = time.perf_counter()
                seen = observation(frame, LAYOUT, camera)
                row = {"noise": noise, "scene": index, **scene_row(placed, seen)}
                times = {"frame_s": taken - started, "reading_s": time.perf_counter() - taken}
                again = (scene_row(placed, noisy.look()) for _ in range(_LOOKS - 1) if noise == "kinect")
                understood = not row["wrong"] or any(not later["wrong"] for later in again)
                scenes.append(row | times | {"understood": understood})
                objects += [{"noise": noise, "scene": index, **one} for one in object_rows(placed, seen.objects)]
                if index == 0 and noise == "kinect":
                    first = frame, seen.objects, placed
    return scenes, objects, first


def lying_scenes(camera: CameraConfig, count: int, seed: int) -> Rows:
    """Whether a lying object was reported, scene by scene, with noise; scenes without room for one are left out."""
    found: Rows = []
    for index in trange(10 * count, desc="lying", total=count, file=sys.stderr):
        rng = np.random.default_rng([seed, 1, index])
        placed = random_arrangement(LAYOUT, rng, most=_FEW_OBSTACLES)
        with standing(placed, camera) as env:
            if lay_down(env, placed, rng):
                seen = RgbdCamera(env, seed=index).look()
                found.append({"scene": index, "reported": scene_row(placed, seen)["lying"]})
        if len(found) == count:
            return found
    raise RuntimeError(f"only {len(found)} of {count} scenes have room for a lying object")


def hidden_scenes(camera: CameraConfig, count: int, seed: int) -> Rows:
    """Whether a smallest object behind tall ones was detected, or its scene refused, in `_LOOKS` looks each."""
    found: Rows = []
    for index in trange(count, desc="hidden", file=sys.stderr):
        rng = np.random.default_rng([seed, 2, index])
        placed = with_small_one(random_arrangement(LAYOUT, rng), camera, rng)
        with standing(placed, camera) as env:
            noisy = RgbdCamera(env, seed=index)
            for _ in range(_LOOKS):
                seen = noisy.look()
                detected = any(math.dist(one.xy, placed.xy[-1]) < _FOUND_WITHIN_M for one in seen.objects)
                missed = not detected and not scene_row(placed, seen)["wrong"]
                found.append({"scene": index, "detected": detected, "missed": missed})
    return found


def scene_row(placed: Arrangement, seen: Observation) -> dict[str, Any]:
    """Whether the whole scene, and the target, are right; wrong: why the scene was not understood.

    lying: whether that is because an object does not stand upright.
    """
    targets = [cell_of(one, placed.layout) for one in seen.objects if one.is_target]
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


if __name__ == "__main__":
    sys.exit(run(main, Options))
