"""Where the objects of an episode start: the options of `reset`, checked."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np

from dore.errors import InputError
from dore.sim.config import Body
from dore.sim.frames import Array


def start_cells(cells: Sequence[int] | np.ndarray, most: int, n_cells: int) -> np.ndarray:
    """Int64[K]: the cells of the first K objects.

    Raises:
        InputError: none, more than `most`, a cell twice, or one off the layout.
    """
    wrong = not 1 <= len(cells) <= most or len(set(map(int, cells))) != len(cells)
    if wrong or not all(0 <= int(cell) < n_cells for cell in cells):
        raise InputError(f"cells: got {list(map(int, cells))}, want up to {most} different cells of the layout")
    return np.asarray(cells, dtype=np.int64)


def check_apart(where: Array, bodies: Sequence[Body]) -> None:
    """Refuse objects that overlap at Float64[B, K, 2]: the simulator would throw them apart.

    Raises:
        InputError: names the first two that overlap.
    """
    for one, other in itertools.combinations(range(where.shape[1]), 2):
        least = bodies[one].half_width_m + bodies[other].half_width_m
        if (np.linalg.norm(where[:, one] - where[:, other], axis=-1) < least).any():
            raise InputError(f"offsets_m: objects {one} and {other} overlap, want them apart")


def for_each(name: str, count: int, width: int, options: dict[str, Any]) -> Array:
    """Float64[K, width]: an option for each of K objects; zeros if not given.

    Raises:
        InputError: not so many numbers.
    """
    given, shape = options.get(name), (count, width)
    if given is None:
        return np.zeros(shape)
    try:
        values = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        values = np.empty(0)
    if values.shape != (shape if width > 1 else shape[:1]) or not np.isfinite(values).all():
        each = "a number" if width == 1 else f"{width} numbers"
        raise InputError(f"{name}: got {given!r}, want {each} for each of {count} objects")
    return values.reshape(shape)
