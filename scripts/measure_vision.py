"""How well the camera reads the board: random scenes in the simulator, with a real sensor's depth noise and without.

python -m scripts.measure_vision OUT [--scenes 200] [--lying 40] [--seed 1] [--camera kinect] [--picture FILE]
Objects of both shapes and of random sizes stand up to a centimetre from the middle of their cells and turned at random;
the arm is ready. Then scenes in which one object lies, which must be reported. OUT/scenes, OUT/objects and
OUT/lying get a rows.csv each, and the picture the first noisy frame; `dore-report study=vision` makes the page. Needs a
Vulkan driver (scripts/install_lavapipe.sh); about five minutes on one core.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm import trange

from dore.errors import InputError, seed_of, whole
from dore.files import atomic_write
from dore.report.measurements import write_measurements
from dore.sim.config import preset
from dore.sim.scene.agent import render_backend
from dore.sim.vision.camera import RgbdCamera, rendered
from dore.sim.vision.camera_config import CameraConfig
from dore.sim.vision.perception import detections
from dore.world.layout import Layout
from scripts.vision_figure import draw
from scripts.vision_scenes import lay_down, object_rows, random_arrangement, reports_lying, scene_row, standing

LAYOUT = Layout.grid(3, 6, 0.12, 0.50)
_FEW_OBSTACLES = 6
"""At most so many beside a lying object, so that there is room for it."""
Rows = list[dict[str, Any]]


def main(arguments: list[str] | None = None) -> None:
    """Measure, and write the rows and the picture."""
    chosen = _arguments(arguments)
    torch.set_num_threads(1)
    if render_backend() == "none":
        raise SystemExit("error: no Vulkan driver here, so nothing can be seen; see scripts/install_lavapipe.sh")
    camera: CameraConfig = preset(f"camera/{chosen.camera}")
    started = time.perf_counter()
    chosen.picture.parent.mkdir(parents=True, exist_ok=True)
    # A renderer compiles its shaders again once no other is left: this one stays.
    with standing(random_arrangement(LAYOUT, np.random.default_rng(chosen.seed)), camera) as env:
        rendered(env)
        scenes, objects = upright_scenes(camera, chosen.scenes, chosen.seed, chosen.picture)
        lying = lying_scenes(camera, chosen.lying, chosen.seed)
    about = {"seed": chosen.seed, "camera": chosen.camera, "rendering": render_backend()}
    about["seconds"] = f"{time.perf_counter() - started:.0f}"
    about["wrong"] = "; ".join(f"with noise={row['noise']}: {row['wrong']}" for row in scenes if row["wrong"])
    for name, rows in (("objects", objects), ("lying", lying), ("scenes", scenes)):
        write_measurements(chosen.out / name, rows, **about)


def _arguments(given: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of the rows")
    parser.add_argument("--scenes", type=int, default=200, help="with all objects upright")
    parser.add_argument("--lying", type=int, default=40, help="scenes with one object lying down")
    parser.add_argument("--seed", type=int, default=1, help="of scenes and noise; settings were chosen on seed 0")
    parser.add_argument("--camera", default="kinect", help="which of conf/camera")
    parser.add_argument("--picture", type=Path, default=Path("docs/results/vision.png"))
    chosen = parser.parse_args(given)
    try:
        whole("--scenes", chosen.scenes, 1)
        whole("--lying", chosen.lying, 1)
        seed_of("--seed", chosen.seed)
    except InputError as error:
        parser.error(str(error))
    return chosen


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
                    with atomic_write(picture, "wb") as file:
                        draw(file, frame, seen, placed)
    return scenes, objects


def lying_scenes(camera: CameraConfig, count: int, seed: int) -> Rows:
    """Whether a lying object was reported, scene by scene, with noise; scenes without room for one are left out."""
    found: Rows = []
    for index in trange(10 * count, desc="lying", total=count, file=sys.stderr):
        rng = np.random.default_rng([seed, 1, index])
        placed = random_arrangement(LAYOUT, rng, most=_FEW_OBSTACLES)
        with standing(placed, camera) as env:
            if lay_down(env, placed, rng):
                found.append({"scene": index, "reported": reports_lying(RgbdCamera(env, seed=index).look(), LAYOUT)})
        if len(found) == count:
            return found
    raise RuntimeError(f"only {len(found)} of {count} scenes have room for a lying object")


if __name__ == "__main__":
    main()
