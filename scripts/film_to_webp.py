"""Convert a film to an animated picture for a web page: every second frame, smaller.

scripts/film_to_webp.py outputs/fig7/execution.mp4 docs/images/arm.webp
"""

from __future__ import annotations

import argparse

import imageio.v2 as imageio
from PIL import Image

from dore.files import atomic_write

EVERY, QUALITY = 2, 60
LAST_MS = 2500
"""How long the last frame is shown."""


def main() -> None:
    """Read the film and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("film", help="an mp4, as dore-execute makes it")
    parser.add_argument("picture", help="the webp")
    parser.add_argument("--width", type=int, default=960, help="pixels")
    options = parser.parse_args()
    with imageio.get_reader(options.film) as reader:
        rate = reader.get_meta_data()["fps"]
        frames = [Image.fromarray(frame) for index, frame in enumerate(reader) if index % EVERY == 0]
    size = (options.width, round(frames[0].height * options.width / frames[0].width))
    first, *others = [frame.resize(size, Image.Resampling.LANCZOS) for frame in frames]
    durations_ms = [round(1000 * EVERY / rate)] * len(others) + [LAST_MS]
    with atomic_write(options.picture, "wb") as file:
        first.save(
            file, format="webp", save_all=True, append_images=others, duration=durations_ms, loop=0, quality=QUALITY
        )


if __name__ == "__main__":
    main()
