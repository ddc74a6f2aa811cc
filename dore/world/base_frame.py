"""A plan in metres and degrees of the robot's base frame, so that another program can carry it out without this one."""

from __future__ import annotations

import math

import msgspec

from dore.errors import InputError
from dore.schema import Degrees
from dore.world.plan import Plan
from dore.world.problem import Problem

AXES = "x forward, y left, origin at the base; headings counter-clockwise from x"
TOLERANCE = 1e-5
"""Metres and degrees: files are rounded to a tenth of that."""


class Approach(msgspec.Struct, forbid_unknown_fields=True):
    """A cell's centre, metres, and the way the hand moves towards it, degrees."""

    centre_m: tuple[float, float]
    heading_deg: Degrees


class PickAndPlace(msgspec.Struct, forbid_unknown_fields=True):
    """The two approaches of a move."""

    pick: Approach
    place: Approach


class BaseFrame(msgspec.Struct, forbid_unknown_fields=True):
    """What a plan file holds beside cells and directions about cell-to-base, which say the same.

    target: None unless the plan solves.
    """

    axes: str
    moves: list[PickAndPlace]
    target: Approach | None


def in_base_frame(problem: Problem, plan: Plan) -> BaseFrame:
    """The approaches of a plan, as `dore.world.plan.replay` checks them."""

    def approach(cell: int, direction_deg: float) -> Approach:
        x, y = problem.scene.layout.cells[cell]
        heading = math.remainder(math.degrees(math.atan2(y, x)) + direction_deg, 360.0)
        return Approach((round(x, 6), round(y, 6)), round(heading, 6))

    moves = [
        PickAndPlace(approach(move.pick, move.pick_direction_deg), approach(move.place, move.place_direction_deg))
        for move in plan.moves
    ]
    direction = plan.target_direction_deg
    return BaseFrame(AXES, moves, None if direction is None else approach(problem.scene.target, direction))


def check_base_frame(given: BaseFrame, problem: Problem, plan: Plan) -> None:
    """Refuse approaches that are not those of the plan: one of the two would be carried out in vain.

    Raises:
        InputError: names the first one that differs.
    """
    wanted = in_base_frame(problem, plan)
    if len(given.moves) != len(wanted.moves):
        raise InputError(f"base_frame.moves: got {len(given.moves)}, want {len(wanted.moves)}, as the plan has")
    pairs = [
        (f"moves[{number}].{part}", getattr(one, part), getattr(other, part))
        for number, (one, other) in enumerate(zip(given.moves, wanted.moves, strict=True))
        for part in ("pick", "place")
    ]
    for name, one, other in (*pairs, ("target", given.target, wanted.target)):
        if (one is None) != (other is None) or (one and other and _apart(one, other) > TOLERANCE):
            raise InputError(f"base_frame.{name}: got {one}, want {other}, as cells and directions say")


def _apart(one: Approach, other: Approach) -> float:
    turned = abs(math.remainder(one.heading_deg - other.heading_deg, 360.0))
    return max(math.dist(one.centre_m, other.centre_m), turned)
