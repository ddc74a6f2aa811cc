"""How well the camera reads the board: random scenes in the simulator, with a real sensor's depth noise and without.

python -m scripts.measure_vision out=FOLDER [scenes=200] [lying=40] [seed=1] [camera=kinect] [picture=FILE]
Objects of both shapes and of random sizes stand up to a centimetre from the middle of their cells and turned at random;
the arm is ready. Then scenes in which one object lies, which must be reported. FOLDER/scenes, FOLDER/objects and
FOLDER/lying get a rows.csv each, and the picture the first noisy frame; `dore-report study=vision` makes the page.
Needs a Vulkan driver (scripts/install_lavapipe.sh); about five minutes on one core.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import trange

from dore.errors import seed_of, whole
from dore.files import check_outputs
from dore.report.measurements import write_measurements
from dore.sim.config import preset
from dore.sim.scene.agent import render_backend
from dore.sim.vision.camera import RgbdCamera, rendered
from dore.sim.vision.camera_config import CameraConfig
from dore.sim.vision.perception import detections
from dore.world.layout import Layout
from scripts.program import run
from scripts.vision_figure import draw
from scripts.vision_scenes import lay_down, object_rows, random_arrangement, scene_row, standing

LAYOUT = Layout.grid(3, 6, 0.12, 0.50)
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

    def __post_init__(self) -> None:
        whole("scenes", self.scenes, 1)
        whole("lying", self.lying, 1)
        seed_of("seed", self.seed)


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
                seen = RgbdCamera(env, seed=index).look()
                found.append({"scene": index, "reported": scene_row(placed, seen)["lying"]})
        if len(found) == count:
            return found
    raise RuntimeError(f"only {len(found)} of {count} scenes have room for a lying object")


if __name__ == "__main__":
    sys.exit(run(main, Options))
