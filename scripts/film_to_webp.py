"""Convert a film to an animated picture for a web page: every second frame, smaller.

python -m scripts.film_to_webp film=outputs/fig7/execution.mp4 picture=docs/images/arm.webp
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import imageio.v2 as imageio
from PIL import Image

from dore.files import atomic_write
from scripts.program import run

EVERY, WIDTH, QUALITY = 2, 960, 60
LAST_MS = 2500
"""How long the last frame is shown."""


@dataclass(frozen=True)
class Options:
    """film: an mp4, as dore-execute makes it. picture: the webp."""

    film: Path
    picture: Path


def main(options: Options) -> None:
    """Read the film and write the picture."""
    with imageio.get_reader(options.film) as reader:
        rate = reader.get_meta_data()["fps"]
        frames = [Image.fromarray(frame) for index, frame in enumerate(reader) if index % EVERY == 0]
    size = (WIDTH, round(frames[0].height * WIDTH / frames[0].width))
    first, *others = [frame.resize(size, Image.Resampling.LANCZOS) for frame in frames]
    shown_ms = [round(1000 * EVERY / rate)] * len(others) + [LAST_MS]
    look = {"save_all": True, "duration": shown_ms, "loop": 0, "quality": QUALITY}
    with atomic_write(options.picture, "wb") as file:
        first.save(file, format="webp", append_images=others, **look)


if __name__ == "__main__":
    sys.exit(run(main, Options))
