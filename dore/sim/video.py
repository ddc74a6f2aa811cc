"""Frames of a running environment into an mp4, which appears whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path
from types import TracebackType
from typing import Any

import imageio.v2 as imageio

from dore.sim.config import CameraConfig


class Video:
    """A context manager that films an environment.

    Args:
        env: a `DoreTabletop-v1`; its camera says how often to look.
        path: the mp4.
        step_s: simulated seconds of one control step.
        on: False films nothing, where nothing can render.
    """

    def __init__(self, env: Any, path: Path, step_s: float, on: bool) -> None:
        self._env, self._path, self._on = env, path, on
        camera: CameraConfig = env.unwrapped.camera
        self._every = max(1, round(camera.playback_speed / (camera.frames_per_s * step_s)))
        self._rate = camera.playback_speed / (self._every * step_s)
        self._partial = path.with_name(f".{path.stem}.{os.getpid()}.part.mp4")
        self._steps = 0
        self.written = False

    def __enter__(self) -> Video:
        if self._on:
            self._writer = imageio.get_writer(self._partial, fps=self._rate, quality=7, macro_block_size=8)
        return self

    def after_step(self) -> None:
        """Take a frame if it is time for one."""
        if self._on and self._steps % self._every == 0:
            self._writer.append_data(self._env.render()[0].cpu().numpy())
        self._steps += 1

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not self._on:
            return
        self._writer.close()
        if kind is None:
            os.replace(self._partial, self._path)
            self.written = True
        else:
            self._partial.unlink(missing_ok=True)
