"""The one exception that means "what you gave me is wrong", and the commands' exit codes; it loads nothing."""

from __future__ import annotations

import math
import operator
import os
import re
import shlex
from enum import IntEnum
from pathlib import Path
from typing import get_args


class ExitCode(IntEnum):
    """What a command ends with."""

    OK = 0
    FAILED = 1
    """Training diverged, a job broke, or an execution met a fault."""
    BAD_INPUT = 2
    UNSOLVABLE = 3
    """dore-plan: proved to have no plan."""
    REFUSED = 3
    """dore-execute: nothing was moved."""
    GAVE_UP = 4
    STOPPED = 130
    """By Ctrl-C; can be resumed."""


class InputError(ValueError):
    """Bad input: one line that names the field, its value and what was wanted. The CLI exits with 2."""


MOST = 10**12
"""No count that this program takes is larger."""


def whole(name: str, value: object, at_least: int, at_most: int = MOST) -> int:
    """`value` as an int of `at_least` or more, and `at_most` at most; integers of NumPy and torch will do.

    Raises:
        InputError: it is no whole number, too small, or too large.
    """
    found = integer(value)
    if found is None or found < at_least:
        raise InputError(f"{name}: got {shown(value)}, want a whole number of {at_least} or more")
    if found > at_most:
        raise InputError(f"{name}: got {shown(value)}, want {at_most} at most")
    return found


def shown(value: object) -> str:
    """A value as a message names it: a line of 80 characters at most."""
    try:
        text = " ".join(repr(value).split())
    except ValueError:  # An int of more digits than Python prints.
        text = "a number of thousands of digits"
    return text if len(text) <= 80 else f"{text[:77]}..."


def pasted(key: str, value: object) -> str:
    """KEY=VALUE as it can be pasted into a shell after a command."""
    text = str(value)
    if not re.fullmatch(r"[A-Za-z0-9_./+-]+", text):
        text = "'" + text.replace("'", r"\'") + "'"  # For Hydra; the shell's come around it.
    return shlex.quote(f"{key}={text}")


def integer(value: object) -> int | None:
    """An integer of Python, NumPy or torch as an int; None for a bool and everything else."""
    if isinstance(value, bool) or "bool" in str(getattr(value, "dtype", "")):
        return None
    try:
        return operator.index(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return None


def seed_of(name: str, value: object) -> int:
    """`value` as a seed that every generator takes: 0 to 2**32 - 1."""
    return whole(name, value, 0, at_most=2**32 - 1)


def flag(name: str, value: object) -> bool:
    """`value` as a bool.

    Raises:
        InputError: it is neither true nor false.
    """
    if not isinstance(value, bool):
        raise InputError(f"{name}: got {shown(value)}, want true or false")
    return value


def one_of(name: str, value: object, options: object) -> None:
    """Nothing, if `value` is an option of a Literal type.

    Raises:
        InputError: it is not an option.
    """
    if value not in get_args(options):
        raise InputError(f"{name}: got {shown(value)}, want one of {', '.join(get_args(options))}")


def path_of(name: str, value: object) -> Path:
    """`value` as a path.

    Raises:
        InputError: it is no text, or empty.
    """
    if not isinstance(value, str | os.PathLike) or not os.fspath(value):
        raise InputError(f"{name}: got {shown(value)}, want a path")
    return Path(value)


def number(
    name: str,
    value: object,
    above: float = -math.inf,
    at_most: float = math.inf,
    unit: str = "",
    at_least: float = -math.inf,
) -> float:
    """`value` as a finite float in (above, at_most], and at least `at_least`; numbers of NumPy and torch will do.

    Args:
        unit: what the message says that the number is in.

    Raises:
        InputError: it is no number, not finite, or outside the interval.
    """
    found = _real(value)
    if not math.isfinite(found) or not above < found <= at_most or found < at_least:
        bounds = [f"above {above:g}"] * (above > -math.inf) + [f"of {at_least:g} or more"] * (at_least > -math.inf)
        bounds += [f"at most {at_most:g}"] * (at_most < math.inf)
        wanted = "want a finite number" + " and".join(f" {bound}" for bound in bounds)
        raise InputError(f"{name}: got {shown(value)}, {wanted}" + f" ({unit})" * bool(unit))
    return found


def _real(value: object) -> float:
    """A number of Python, NumPy or torch as a float; nan for what is none, or too large for one."""
    kind = str(getattr(value, "dtype", ""))
    if isinstance(value, bool | str | bytes) or "bool" in kind or not hasattr(value, "__float__"):
        return math.nan
    try:
        return float(value)
    except (OverflowError, TypeError, ValueError, RuntimeError):
        return math.nan
