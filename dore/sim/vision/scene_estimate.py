"""From detected objects to a scene that can be planned for, or one line that says why there is none."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from enum import StrEnum
from typing import Literal, NamedTuple

import numpy as np

from dore.sim.config import Body
from dore.sim.frames import inside
from dore.world.layout import Layout
from dore.world.problem import Scene, cell_id

Shape = Literal["cuboid", "cylinder"]


class Why(StrEnum):
    """Why a picture was not understood."""

    NO_TABLE = "no_table"
    NOT_MEASURED = "not_measured"
    """Cells of which it is not known whether they are empty."""
    NOT_WHOLE = "not_whole"
    """An object leans, is seen in part, or is several: stacked, or side by side."""
    NOT_UPRIGHT = "not_upright"
    """An object lies down, or touches another, or something hangs over the board."""
    OFF_BOARD = "off_board"
    SHARED_CELL = "shared_cell"
    NO_TARGET = "no_target"
    TWO_TARGETS = "two_targets"


class NotUnderstood(Exception):
    """The observation is not a valid scene. `why`: of what kind; `reason`: one line, with ids 1..G and metres."""

    def __init__(self, why: Why, message: str) -> None:
        super().__init__(f"the camera: {message}")
        self.why, self.reason = why, message


@dataclass(frozen=True)
class Detection:
    """One detected object.

    xy: middle of the top face, metres, world frame; if not upright, the middle of what is seen of it.
    half_width_m: half a cuboid's side, a can's radius; half the length of what is not upright.
    height_m: of its top above the table.
    yaw_rad: how a cuboid is turned, in (-pi/4, pi/4]; 0 for all others.
    shape: of the top face; meaningless if not upright.
    upright: stands on its own; False for what lies, for several that touch, and for what hangs over a cell.
    doubt: why it is not one whole object, in a few words; empty: nothing speaks against it.
    """

    xy: tuple[float, float]
    half_width_m: float
    height_m: float
    yaw_rad: float
    shape: Shape
    upright: bool
    is_target: bool
    doubt: str = ""

    def __str__(self) -> str:
        return f"{'target' if self.is_target else 'object'} at ({self.xy[0]:.3f}, {self.xy[1]:.3f}) m"


class Observation(NamedTuple):
    """What one frame shows of a board."""

    objects: tuple[Detection, ...]
    unmeasured: frozenset[int] = frozenset()
    """Cells, from 0, of which it is not known whether they are empty."""


@dataclass(frozen=True)
class SceneEstimate:
    """The scene that the detected objects make, its obstacles in ascending order, and the objects, the target first."""

    scene: Scene
    objects: tuple[Detection, ...]

    def __str__(self) -> str:
        listed = ", ".join(str(cell_id(cell)) for cell in self.scene.obstacles)
        return f"target on {cell_id(self.scene.target)}, obstacles on {listed or 'no cell'}"

    @property
    def bodies(self) -> tuple[Body, ...]:
        """Every object as wide and as tall as it is seen."""
        return tuple(Body(one.shape, one.half_width_m, one.height_m) for one in self.objects)


def cell_of(detection: Detection, layout: Layout) -> int | None:
    """The cell that an object's middle is in, from 0; the nearest, where cells overlap; None: off the board."""
    centres, xy = layout.centres.numpy(), np.array(detection.xy)
    if not inside(centres, layout.cell_m, xy).any():
        return None
    return int(np.abs(centres - xy).max(axis=1).argmin())


def estimate(seen: Observation, layout: Layout) -> SceneEstimate:
    """The scene that the camera sees: every cell is empty, or holds one whole object.

    Raises:
        NotUnderstood: an object is off the board, not upright or not whole; two share a cell; no target, or two; or it
            is not known whether a cell is empty.
    """
    on: dict[int, Detection] = {}
    for one in seen.objects:
        cell = cell_of(one, layout)
        if cell is None:
            raise NotUnderstood(Why.OFF_BOARD, f"the {one} is outside every cell")
        if not one.upright:
            size = f"{one.height_m:.2f} m high and {2 * one.half_width_m:.2f} m long"
            raise NotUnderstood(Why.NOT_UPRIGHT, f"the {one} does not stand upright on its own: {size}")
        if one.doubt:
            raise NotUnderstood(
                Why.NOT_WHOLE, f"the {one} in cell {cell_id(cell)} is not one whole object: {one.doubt}"
            )
        if cell in on:
            two = f"the {on[cell]} and the {one}"
            raise NotUnderstood(Why.SHARED_CELL, f"two objects in cell {cell_id(cell)}: {two}; want one at most")
        on[cell] = one
    if seen.unmeasured:
        raise NotUnderstood(
            Why.NOT_MEASURED, f"{_listed(seen.unmeasured)} not measured: something may stand there unseen"
        )
    targets = sorted(cell for cell, one in on.items() if one.is_target)
    if not targets:
        raise NotUnderstood(Why.NO_TARGET, f"no target seen, but {len(on)} obstacles")
    if len(targets) > 1:
        ids = " and ".join(str(cell_id(cell)) for cell in targets)
        raise NotUnderstood(Why.TWO_TARGETS, f"{len(targets)} targets seen, in cells {ids}; want one")
    scene = Scene(layout, tuple(sorted(set(on) - set(targets))), targets[0])
    return SceneEstimate(scene, tuple(on[cell] for cell in (scene.target, *scene.obstacles)))


def _listed(cells: Collection[int]) -> str:
    """ "cell 3 is", "cells 3 and 7 are"."""
    ids = [str(cell_id(cell)) for cell in sorted(cells)]
    return f"cell {ids[0]} is" if len(ids) == 1 else f"cells {', '.join(ids[:-1])} and {ids[-1]} are"


def unconfirmed(seen: Observation, before: Scene) -> str | None:
    """Why it is not sure that the target, and nothing else, has left a board; None: it is."""
    # What hangs in the hand, in front of the grid, is not on the board.
    on_board = [one for one in seen.objects if one.xy[0] > before.layout.front_m]
    if any(one.is_target for one in on_board):
        return "the target still stands on the board"
    cells = [cell_of(one, before.layout) if one.upright else None for one in on_board]
    if len(cells) != len(before.obstacles) or set(cells) != set(before.obstacles):
        return "the obstacles do not stand where they stood"
    if seen.unmeasured:
        return f"{_listed(seen.unmeasured)} not measured"
    return None
