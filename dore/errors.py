"""The one exception that means "what you gave me is wrong"; it loads nothing."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import get_args


class InputError(ValueError):
    """Bad input: one line that names the field, its value and what was wanted. The CLI exits with 2."""


def whole(name: str, value: object, at_least: int, at_most: int | None = None) -> int:
    """`value` as an int of `at_least` or more, and `at_most` at most.

    Raises:
        InputError: it is no whole number, too small, or too large.
    """
    if isinstance(value, bool) or not isinstance(value, int) or value < at_least:
        raise InputError(f"{name}: got {value!r}, want a whole number of {at_least} or more")
    if at_most is not None and value > at_most:
        raise InputError(f"{name}: got {value!r}, want {at_most} at most")
    return value


def seed_of(name: str, value: object) -> int:
    """`value` as a seed that every generator takes: 0 to 2**32 - 1."""
    return whole(name, value, 0, at_most=2**32 - 1)


def flag(name: str, value: object) -> bool:
    """`value` as a bool.

    Raises:
        InputError: it is neither true nor false.
    """
    if not isinstance(value, bool):
        raise InputError(f"{name}: got {value!r}, want true or false")
    return value


def one_of(name: str, value: object, options: object) -> None:
    """Nothing, if `value` is an option of a Literal type.

    Raises:
        InputError: it is not an option.
    """
    if value not in get_args(options):
        raise InputError(f"{name}: got {value!r}, want one of {', '.join(get_args(options))}")


def path_of(name: str, value: object) -> Path:
    """`value` as a path.

    Raises:
        InputError: it is no text, or empty.
    """
    if not isinstance(value, str | os.PathLike) or not os.fspath(value):
        raise InputError(f"{name}: got {value!r}, want a path")
    return Path(value)


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
