"""From what was seen to a scene that can be planned for, or one line that says why not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

import numpy as np

from dore.sim.motion.frames import inside
from dore.world.layout import Layout
from dore.world.plan import Scene, cell_id

Shape = Literal["cuboid", "cylinder"]


class Why(StrEnum):
    """Why a picture was not understood."""

    NO_TABLE = "no_table"
    NOT_UPRIGHT = "not_upright"
    """An object lies down, or touches another, or something hangs over the board."""
    OFF_BOARD = "off_board"
    SHARED_CELL = "shared_cell"
    NO_TARGET = "no_target"
    TWO_TARGETS = "two_targets"


class NotUnderstood(Exception):
    """What the camera sees is no scene. `why`: of what kind; `reason`: one line, with ids 1..G and metres."""

    def __init__(self, why: Why, message: str) -> None:
        super().__init__(f"the camera: {message}")
        self.why, self.reason = why, message


@dataclass(frozen=True)
class Sighting:
    """One object as it was seen.

    xy: middle of the top face, metres, world frame; of what is not upright, the middle of what is seen of it.
    half_width_m: half a cuboid's side, a can's radius; half the length of what is not upright.
    height_m: of its top above the table.
    yaw_rad: how a cuboid is turned, in (-pi/4, pi/4]; 0 for all others.
    shape: of the top face; of what is not upright it says nothing.
    upright: stands on its own; False for what lies, for several that touch, and for what hangs over a cell.
    """

    xy: tuple[float, float]
    half_width_m: float
    height_m: float
    yaw_rad: float
    shape: Shape
    upright: bool
    is_target: bool

    def __str__(self) -> str:
        return f"{'target' if self.is_target else 'object'} at ({self.xy[0]:.3f}, {self.xy[1]:.3f}) m"


def cell_of(sighting: Sighting, layout: Layout) -> int | None:
    """The cell that an object's middle is in, from 0; the nearest, where cells overlap; None: off the board."""
    centres, xy = layout.centres.numpy(), np.array(sighting.xy)
    if not inside(centres, layout.cell_m, xy).any():
        return None
    return int(np.abs(centres - xy).max(axis=1).argmin())


def scene_of(sightings: Sequence[Sighting], layout: Layout) -> Scene:
    """The board as it was seen; obstacles in ascending order.

    Raises:
        NotUnderstood: an object is off the board, or not upright; two share a cell; no target, or two.
    """
    holds: dict[int, Sighting] = {}
    for one in sightings:
        cell = cell_of(one, layout)
        if cell is None:
            raise NotUnderstood(Why.OFF_BOARD, f"the {one} is outside every cell")
        if not one.upright:
            size = f"{one.height_m:.2f} m high and {2 * one.half_width_m:.2f} m long"
            raise NotUnderstood(Why.NOT_UPRIGHT, f"the {one} does not stand upright on its own: {size}")
        if cell in holds:
            two = f"the {holds[cell]} and the {one}"
            raise NotUnderstood(Why.SHARED_CELL, f"two objects in cell {cell_id(cell)}: {two}; want one at most")
        holds[cell] = one
    targets = [cell for cell, one in holds.items() if one.is_target]
    if not targets:
        raise NotUnderstood(Why.NO_TARGET, f"no target seen; {len(holds)} obstacles are")
    if len(targets) > 1:
        ids = " and ".join(str(cell_id(cell)) for cell in sorted(targets))
        raise NotUnderstood(Why.TWO_TARGETS, f"{len(targets)} targets seen, in cells {ids}; want one")
    return Scene(layout, tuple(sorted(set(holds) - set(targets))), targets[0])
