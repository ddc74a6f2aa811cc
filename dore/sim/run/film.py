"""The film of a running environment: an mp4 with captions, written whole or not at all, and a still of each move."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from types import TracebackType
from typing import Any

import imageio.v2 as imageio
import numpy as np

from dore.draw.boards import Panel
from dore.sim.config import ViewConfig
from dore.sim.frames import inside
from dore.sim.run.film_frame import FilmFrame, Pixels, save_png
from dore.sim.scene.scene_builder import OBSTACLE_PAINTS, TARGET_PAINT, Colour
from dore.world.problem import Scene

READING_S = 0.8
"""How long the film stands still for a line that says what has happened, seconds of film."""


class Film:
    """A context manager that films an environment, with the board beside it and a caption below.

    Args:
        env: a `DoreTabletop-v1`; its `view` says how large the picture is and how often to take one.
        path: the mp4.
        step_s: simulated seconds of one control step.
        on: False films nothing, where nothing can render; the calls then do nothing.

    `written`: whether the mp4 was written, known at the end. `stills`: names of the PNGs made so far.
    """

    def __init__(self, env: Any, path: Path, step_s: float, on: bool) -> None:
        self._env, self._path, self._step_s, self._on = env, path, step_s, on
        view: ViewConfig = env.unwrapped.view
        self._every = max(1, round(view.playback_speed / (view.frames_per_s * step_s)))
        self._rate = view.playback_speed / (self._every * step_s)
        self._sheet = FilmFrame(view.width_px, view.height_px)
        self._partial = path.with_name(f".{path.stem}.{os.getpid()}.part.mp4")
        self._steps = 0
        self._caption = ""
        self.written = False
        self.stills: list[str] = []

    def __enter__(self) -> Film:
        if self._on:
            self._writer = imageio.get_writer(self._partial, fps=self._rate, quality=7, macro_block_size=8)
        return self

    def caption(self, text: str, panel: Panel | None = None) -> None:
        """Put this line under the coming frames, as "move 2 of 3: 3 to 12"; the clock is added. None: same board."""
        self._caption = text
        if self._on and panel is not None:
            self._sheet.show_board(panel, self._colours(panel.scene))

    def pause(self, line: str, panel: Panel | None = None, still: str | None = None) -> None:
        """Stand still for a line that says what has happened or is seen; it stays in the list beside the picture.

        still: keep this picture too, as a PNG beside the film: its name without the ending, as "move_1".

        Raises:
            OSError: the disk is full or read-only.
        """
        self.caption(line, panel)
        if not self._on:
            return
        self._sheet.add_line(line, self._clock)
        frame = self._frame()
        for _ in range(max(1, round(READING_S * self._rate))):
            self._append(frame)
        if still is not None:
            file = self._path.with_name(f"{still}.png")
            save_png(frame, file)
            self.stills.append(file.name)

    def after_step(self) -> None:
        """Count a control step, and take a frame if one is due.

        Raises:
            OSError: the disk is full or read-only.
        """
        self._steps += 1
        if self._on and (self._steps - 1) % self._every == 0:
            self._append(self._frame())

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not self._on:
            return
        try:
            self._writer.close()
            # Without a frame there is no file.
            if kind is None and self._partial.exists():
                os.replace(self._partial, self._path)
                self.written = True
        finally:
            self._partial.unlink(missing_ok=True)

    def _append(self, frame: Pixels) -> None:
        try:
            self._writer.append_data(frame)
        except OSError as error:
            # The encoder's own message is its command line.
            raise OSError(errno.EIO, "the film cannot be written, is the disk full?", str(self._path)) from error

    @property
    def _clock(self) -> str:
        return f"{self._steps * self._step_s:.1f} s"

    def _frame(self) -> Pixels:
        picture = self._env.render()[0].cpu().numpy()
        return self._sheet.frame(picture, self._caption, f"simulated {self._clock}")

    def _colours(self, scene: Scene) -> dict[int, Colour]:
        """The colour of the object that stands on each cell, so that board and picture match."""
        centres, cell_m = scene.layout.centres.numpy(), scene.layout.cell_m
        colours = {}
        for body, xyz in enumerate(self._env.unwrapped.positions()[0].cpu().numpy()):
            colour = TARGET_PAINT if body == 0 else OBSTACLE_PAINTS[body % len(OBSTACLE_PAINTS)]
            colours.update(dict.fromkeys(np.flatnonzero(inside(centres, cell_m, xyz[:2])).tolist(), colour))
        return colours
