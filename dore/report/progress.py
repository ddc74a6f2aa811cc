"""How far long work is: a bar on a terminal, and a line now and then where there is none."""

from __future__ import annotations

import sys
import time
from typing import Any

from tqdm import tqdm

PRINT_S = 30.0
"""Seconds between two lines."""


class ProgressBar(tqdm):
    """A tqdm bar on stderr; in a pipe or a log file it prints a line every `PRINT_S` seconds instead."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(disable=None, **settings)
        self._name, self._unit = settings.get("desc", ""), settings["unit"]
        self._began = self._printed_at = time.monotonic()

    def set_description(self, desc: str | None = None, refresh: bool | None = True) -> None:
        """What is being worked on."""
        self._name = desc or ""
        super().set_description(desc, refresh)

    def update(self, n: float | None = 1) -> bool | None:
        """`n` more are done."""
        if not self.disable:
            return super().update(n)
        self.n += n or 0
        if (seconds := self.due()) is not None:
            line = f"{self._name}: {self.n:,} of {self.total:,} {self._unit}s in {seconds:.0f} s"
            print(line.removeprefix(": "), file=sys.stderr, flush=True)
        return None

    def due(self) -> float | None:
        """The seconds so far, if there is no bar and the last line was `PRINT_S` ago; the caller then prints one."""
        now = time.monotonic()
        if not self.disable or now - self._printed_at <= PRINT_S:
            return None
        self._printed_at = now
        return now - self._began
