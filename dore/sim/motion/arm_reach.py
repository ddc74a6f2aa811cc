"""The reach that an arm gives the planners, so that they plan with what it can do, and how another reach differs."""

from __future__ import annotations

import math

import numpy as np
from torch import Tensor

from dore.sim.config import ArmConfig, ObjectConfig
from dore.sim.frames import Array, corridor
from dore.sim.kinematics import ArmKinematics, Reached, Unreachable
from dore.sim.urdf import arm_files
from dore.world.board import unpack
from dore.world.layout import Layout
from dore.world.problem import cell_id
from dore.world.reach import Reach

_END_TRIES = 20
"""Steps to the end of a corridor before it counts as out of reach; on 3 x 6 cells 10 are enough."""


def arm_reach(arm: ArmConfig, objects: ObjectConfig, layout: Layout, kinematics: ArmKinematics | None = None) -> Reach:
    """The reach of an arm among objects; `reach=panda_slim` has the same numbers, as a test checks.

    Half a corridor's width is that of the open hand, or of the widest object in it, plus the widest object beside the
    corridor, plus the margin; rounded up to the millimetre.

    kinematics: of the same arm, where the caller has built it.

    Raises:
        InputError: an arm whose description is missing or wrong.
    """
    kinematics = kinematics or ArmKinematics(arm_files(visuals=False, arm=arm), arm)
    widest = objects.widest.radius_m
    clearance = max(kinematics.hand_half_width_m, widest) + widest + arm.corridor_margin_m
    return Reach(
        layout,
        clearance_m=math.ceil(1e3 * clearance - 1e-6) / 1e3,
        half_fan_deg=arm.half_fan_deg,
        n_sectors=arm.n_sectors,
        staging_m=arm.staging_m,
        lateral_limit_m=arm.lateral_limit_m,
        max_yaw_deg=arm.max_yaw_deg,
    )


def corridor_differences(planned: Reach, own: Reach) -> str | None:
    """What a plan made for one reach may ask of an arm with another, in words; None: nothing.

    Each corridor of `planned` is checked under `own`'s rules, at its own direction: whether it is allowed there but not
    here, and whether fewer cells must be empty for it there. Both are of the same layout.
    """
    here = Reach(
        own.layout, own.clearance_m, planned.half_fan_deg, planned.n_sectors,
        own.staging_m, own.lateral_limit_m, own.max_yaw_deg,
    )  # fmt: skip
    in_fan = here.sectors_deg.abs() <= own.half_fan_deg + 1e-6
    followed = here.allowed_sectors & in_fan
    not_here = planned.allowed_sectors & ~followed
    needed, asked = unpack(here.blockers, own.n_cells), unpack(planned.blockers, own.n_cells)
    narrower = planned.allowed_sectors & followed & (needed & ~asked).any(-1)
    total = int(planned.allowed_sectors.sum())
    found = [
        f"{int(corridors.sum())} of its {total} corridors ({_ids(corridors.any(-1))}) {what}"
        for corridors, what in (
            (not_here, "are not this arm's"),
            (narrower, "have fewer blocking cells than this arm needs empty"),
        )
        if bool(corridors.any())
    ]
    return "; ".join(found) or None


def cells_out_of_reach(layout: Layout, reach: Reach, kinematics: ArmKinematics) -> tuple[int, ...]:
    """Cells, from 0, that no allowed corridor of `reach` leads to by the arm's inverse kinematics.

    A corridor's end is tried before the way there, and corridors straight out before others. Contacts are not checked.
    """
    try:
        ready = kinematics.ready(layout.front_m - kinematics.arm.staging_m)
    except Unreachable:
        return tuple(range(layout.n_cells))
    order = reach.sectors_deg.abs().argsort().tolist()
    return tuple(
        cell
        for cell in range(layout.n_cells)
        if not any(
            reach.allowed_sectors[cell, s]
            and _leads_to(kinematics, ready, layout.cells[cell], float(reach.sectors_deg[s]))
            for s in order
        )
    )


def follow_corridor(
    kinematics: ArmKinematics, ready: Reached, cell_xy: tuple[float, float], direction_deg: float
) -> tuple[Array, Array, Array]:
    """A corridor from the ready posture: joints Float64[N, J] along the staging line, into the cell at grasp height,
    and, lifted, out of it again.

    Raises:
        Unreachable: a point of it is out of reach, or only reached on another branch.
        ValueError: the corridor does not come from the staging line.
    """
    arm, way = kinematics.arm, corridor(cell_xy, direction_deg, float(ready.xyz[0]))
    low, high, heading = arm.grasp_height_m, arm.grasp_height_m + arm.lift_m, way.heading_rad
    along, at = kinematics.line(ready, np.array([*way.staging_xy, low]), heading)
    into, at = kinematics.line(at, np.array([*cell_xy, low]), heading)
    up, at = kinematics.line(at, np.array([*cell_xy, high]), heading)
    out, at = kinematics.line(at, np.array([*way.staging_xy, high]), heading)
    back, _ = kinematics.line(at, np.array([*ready.xyz[:2], high]), 0.0)
    return np.vstack([ready.joints, along]), np.vstack([along[-1:], into]), np.vstack([up, out, back])


def _leads_to(kinematics: ArmKinematics, ready: Reached, xy: tuple[float, float], direction_deg: float) -> bool:
    arm, staging_x = kinematics.arm, float(ready.xyz[0])
    try:
        heading = corridor(xy, direction_deg, staging_x).heading_rad
        kinematics.solve(np.array([*xy, arm.grasp_height_m + arm.lift_m]), heading, ready.joints, _END_TRIES)
        follow_corridor(kinematics, ready, xy, direction_deg)
    except (Unreachable, ValueError):
        return False
    return True


def _ids(cells: Tensor) -> str:
    """`cell 3` or `cells 1, 4-6` for Bool[G], ids as in the paper."""
    ids = [cell_id(cell) for cell in cells.nonzero().flatten().tolist()]
    runs: list[list[int]] = []
    for one in ids:
        if runs and runs[-1][-1] == one - 1:
            runs[-1].append(one)
        else:
            runs.append([one])
    listed = ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs)
    return f"{'cell' if len(ids) == 1 else 'cells'} {listed}"
