"""How well the camera reads the board: random scenes in the simulator, with a real sensor's depth noise and without.

Objects of both shapes and of random sizes stand up to a centimetre from the middle of their cells and turned at random;
the arm is ready. Then scenes in which one object lies, which must be told.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from statistics import fmean

import numpy as np
import torch
from tqdm import trange

from dore.errors import InputError, seed_of, whole
from dore.files import atomic_write, commit
from dore.report.estimates import share
from dore.report.tables import Table, as_markdown
from dore.sim.config import preset
from dore.sim.scene.agent import render_backend
from dore.sim.vision.camera import RgbdCamera, rendered
from dore.sim.vision.camera_config import CameraConfig
from dore.sim.vision.perception import detections
from dore.world.layout import Layout
from scripts.vision_figure import draw
from scripts.vision_scenes import JITTER_M, OBSTACLES, Score, lay_down, random_arrangement, reports_lying, standing

LAYOUT = Layout.grid(3, 6, 0.12, 0.50)
_FEW_OBSTACLES = 6
"""At most so many beside a lying object, so that there is room for it."""


def main(arguments: list[str] | None = None) -> None:
    """Measure, print the page, and write it beside its picture."""
    chosen = _arguments(arguments)
    torch.set_num_threads(1)
    if render_backend() == "none":
        raise SystemExit("error: no Vulkan driver here, so nothing can be seen; see scripts/install_lavapipe.sh")
    camera: CameraConfig = preset(f"camera/{chosen.camera}")
    started = time.perf_counter()
    chosen.report.parent.mkdir(parents=True, exist_ok=True)
    # A renderer compiles its shaders anew once no other is left: this one stays.
    with standing(random_arrangement(LAYOUT, np.random.default_rng(chosen.seed)), camera) as env:
        rendered(env)
        scores = upright_scenes(camera, chosen.scenes, chosen.seed, chosen.report.with_suffix(".png"))
        told = lying_scenes(camera, chosen.lying, chosen.seed)
    page = _page(chosen, scores, told, time.perf_counter() - started)
    print(page)
    with atomic_write(chosen.report.with_suffix(".md")) as file:
        file.write(page)


def _arguments(given: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=200, help="with all objects upright")
    parser.add_argument("--lying", type=int, default=40, help="scenes with one object lying down")
    parser.add_argument("--seed", type=int, default=1, help="of scenes and noise; settings were chosen on seed 0")
    parser.add_argument("--camera", default="kinect", help="which of conf/camera")
    parser.add_argument("--report", type=Path, required=True, help="the page and its picture, without suffix")
    chosen = parser.parse_args(given)
    try:
        whole("--scenes", chosen.scenes, 1)
        whole("--lying", chosen.lying, 1)
        seed_of("--seed", chosen.seed)
    except InputError as error:
        parser.error(str(error))
    return chosen


def upright_scenes(camera: CameraConfig, count: int, seed: int, picture: Path) -> dict[str, Score]:
    """A score for noisy depth, and one for exact depth, on the same scenes; draws the first noisy one."""
    scores = {"kinect": Score(), "none": Score()}
    for index in trange(count, desc="upright", file=sys.stderr):
        placed = random_arrangement(LAYOUT, np.random.default_rng([seed, 0, index]))
        with standing(placed, camera) as env:
            for noise, score in scores.items():
                started = time.perf_counter()
                frame = RgbdCamera(env, seed=index).frame() if noise == "kinect" else rendered(env)
                taken = time.perf_counter()
                seen = detections(frame, LAYOUT, camera)
                score.frame_s.append(taken - started)
                score.reading_s.append(time.perf_counter() - taken)
                score.add(placed, seen)
                if index == 0 and noise == "kinect":
                    with atomic_write(picture, "wb") as file:
                        draw(file, frame, seen, placed)
    return scores


def lying_scenes(camera: CameraConfig, count: int, seed: int) -> list[bool]:
    """Whether a lying object was told, scene by scene, with noise; scenes without room for one are left out."""
    told: list[bool] = []
    for index in trange(10 * count, desc="lying", total=count, file=sys.stderr):
        rng = np.random.default_rng([seed, 1, index])
        placed = random_arrangement(LAYOUT, rng, most=_FEW_OBSTACLES)
        with standing(placed, camera) as env:
            if lay_down(env, placed, rng):
                told.append(reports_lying(RgbdCamera(env, seed=index).look(), LAYOUT))
        if len(told) == count:
            return told
    raise RuntimeError(f"only {len(told)} of {count} scenes have room for a lying object")


def _page(chosen: argparse.Namespace, scores: dict[str, Score], told: list[bool], seconds: float) -> str:
    wrong = [f"with noise={noise}: {line}" for noise, score in scores.items() for line in score.wrong]
    lines = [
        "# What the camera sees",
        "",
        f"`scripts/measure_vision.sh`, commit {commit()}, seed {chosen.seed} (settings were chosen on seed 0), "
        f"`camera={chosen.camera}`, {render_backend()} rendering; {seconds:.0f} s on one core.",
        "",
        f"{chosen.scenes} random scenes on 3 x 6 cells of 12 cm, {OBSTACLES[0]} to {OBSTACLES[1]} obstacles and the "
        f"target, cuboids and cans mixed (`objects=mixed`), up to {100 * JITTER_M:g} cm from the middle of their cells "
        "and turned at random, the arm ready. The noise is that of a Kinect (`dore/sim/vision/depth_noise.py` "
        "cites it); without it depth is exact to the millimetre. Both look at the same scenes.",
        "",
        as_markdown(_table(scores)),
        "",
        "A share is followed by its 95 % Wilson interval. Exact: every object's cell and the target, and nothing else. "
        "Errors are mean / 95th percentile of their size, over the objects found within 3 cm, which are "
        f"{len(scores['kinect'].centre_mm)} and {len(scores['none'].centre_mm)}.",
        "",
        f"With one object lying, and noise: told in {_share(sum(told), len(told))} scenes (3 to {_FEW_OBSTACLES} "
        "obstacles, so that there is room to lie).",
        "",
        *([f"Not understood: {'; '.join(wrong)}.", ""] if wrong else []),
        "What this does not show: the camera's pose is known exactly, colours are clean and evenly lit, and the "
        "objects are plain: matt, of one colour, with flat tops. A real camera is harder.",
        "",
        f"![A noisy frame with what was seen in it, and the board as seen]({chosen.report.name}.png)",
    ]
    return "\n".join(lines) + "\n"


def _table(scores: dict[str, Score]) -> Table:
    shares: tuple[tuple[str, Callable[[Score], tuple[int, int]]], ...] = (
        ("cells right", lambda s: (s.cells, s.objects)),
        ("scenes exact", lambda s: (s.exact, s.scenes)),
        ("target right", lambda s: (s.target, s.scenes)),
        ("upright right", lambda s: (s.upright, s.objects)),
        ("shape right", lambda s: (s.shape, s.objects)),
    )
    errors: tuple[tuple[str, Callable[[Score], list[float]]], ...] = (
        ("centre, mm", lambda s: s.centre_mm),
        ("height, mm", lambda s: s.height_mm),
        ("half width, mm", lambda s: s.width_mm),
        ("yaw of a cuboid, degrees", lambda s: s.yaw_deg),
    )
    table: Table = [["", "with noise", "without"]]
    table += [[name, *(_share(*of(score)) for score in scores.values())] for name, of in shares]
    table += [[name, *(_error(of(score)) for score in scores.values())] for name, of in errors]
    table += [["to take a frame, s", *(f"{fmean(score.frame_s):.2f}" for score in scores.values())]]
    table += [["to read it, s", *(f"{fmean(score.reading_s):.2f}" for score in scores.values())]]
    return table


def _share(right: int, of: int) -> str:
    interval = share(right, of)
    return f"{right} of {of} [{100 * interval.low:.1f}, {100 * interval.high:.1f}] %"


def _error(values: list[float]) -> str:
    sizes = [abs(value) for value in values]
    return f"{fmean(sizes):.2f} / {np.percentile(sizes, 95):.2f}" if sizes else "-"


if __name__ == "__main__":
    main()
