"""The one exception that means "what you gave me is wrong"; it loads nothing."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any


class InputError(ValueError):
    """Bad input: one line that names the field, its value and what was wanted. The CLI exits with 2."""


def whole(name: str, value: object, at_least: int) -> int:
    """`value` as an int of `at_least` or more.

    Raises:
        InputError: it is no whole number, or too small.
    """
    if isinstance(value, bool) or not isinstance(value, int) or value < at_least:
        raise InputError(f"{name}: got {value!r}, want a whole number of {at_least} or more")
    return value


def number(name: str, value: object, above: float = -math.inf, at_most: float = math.inf) -> float:
    """`value` as a finite float in (above, at_most].

    Raises:
        InputError: it is no number, not finite, or outside the interval.
    """
    wrong = isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value)
    if wrong or not above < value <= at_most:  # type: ignore[operator]
        bounds = [f"above {above:g}"] * (above > -math.inf) + [f"at most {at_most:g}"] * (at_most < math.inf)
        raise InputError(f"{name}: got {value!r}, want a finite number" + " and".join(f" {b}" for b in bounds))
    return float(value)  # type: ignore[arg-type]


@contextmanager
def atomic_write(path: str | os.PathLike[str], mode: str = "w") -> Iterator[IO[Any]]:
    """Open a temporary file beside `path` and rename it over `path` if the block ends well.

    A crash, a full disk or an exception leaves the old file, or none, and never half a new one.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with open(temporary, mode, encoding=None if "b" in mode else "utf-8") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
