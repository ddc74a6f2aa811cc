"""Builds the scene: objects, table and pedestal, and shapes that are only seen. Their colours are here."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import sapien

from dore.sim.config import Body
from dore.sim.frames import TABLE_OVERHANG_M
from dore.world.layout import Layout

Colour = tuple[float, float, float, float]
TARGET_PAINT: Colour = (0.10, 0.58, 0.22, 1)
OBSTACLE_PAINTS: tuple[Colour, ...] = ((0.80, 0.30, 0.20, 1), (0.92, 0.60, 0.16, 1), (0.20, 0.38, 0.66, 1))
_TABLE: Colour = (0.80, 0.76, 0.68, 1)
_LEG: Colour = (0.45, 0.42, 0.38, 1)
_PEDESTAL: Colour = (0.30, 0.32, 0.35, 1)
_FLOOR: Colour = (0.55, 0.57, 0.60, 1)
_LINE: Colour = (0.16, 0.18, 0.22, 1)
_WALL: Colour = (0.66, 0.70, 0.74, 1)
_WALLS = (
    ("wall_behind", (0.02, 6.0, 3.0), (-1.6, 0.0, 2.3)),
    ("wall_beside", (6.0, 0.02, 3.0), (2.0, 2.2, 2.3)),
)
_WAITING_M, _WAITING_PITCH_M = (1.5, 1.5), 0.2
_LINE_HALF_M = 0.0015
_FLOOR_M = 0.62
"""How far the floor lies below the table top, metres."""


def build_surroundings(scene: Any, layout: Layout, base_drop_m: float) -> None:
    """Table and pedestal; if something can render also floor, legs and the grid's lines, which are only seen.

    scene: ManiSkillScene. base_drop_m: how far the arm's base stands below the table top, metres.
    """
    half = layout.cell_m / 2
    centres = layout.centres.numpy()
    near, far = centres.min(0) - half, centres.max(0) + half
    x0, x1 = float(near[0]) - TABLE_OVERHANG_M, float(far[0]) + 0.10
    across = float(np.abs([near[1], far[1]]).max()) + 0.15
    tall = (_FLOOR_M - base_drop_m) / 2
    _slab(scene, "table", [(x1 - x0) / 2, across, 0.02], [(x0 + x1) / 2, 0, -0.02], _TABLE)
    _slab(scene, "shelf", [5.0, 0.2, 0.02], [_WAITING_M[0] + 4.8, _WAITING_M[1], -0.02], _TABLE, seen=False)
    _slab(scene, "pedestal", [0.11, 0.11, tall], [-0.02, 0, -base_drop_m - tall], _PEDESTAL)
    if not scene.can_render():
        return
    _slab(scene, "floor", [6.0, 6.0, 0.02], [2.0, 0, -_FLOOR_M - 0.02], _FLOOR, solid=False)
    for name, size, where in _WALLS:
        _slab(scene, name, size, where, _WALL, solid=False)
    for index, (x, y) in enumerate((x, y) for x in (x0 + 0.03, x1 - 0.03) for y in (-across + 0.03, across - 0.03)):
        leg = (_FLOOR_M - 0.04) / 2
        _slab(scene, f"leg{index}", [0.02, 0.02, leg], [x, y, -0.04 - leg], _LEG, solid=False)
    _draw_cells(scene, centres, half)


def waiting_xy(index: int) -> tuple[float, float]:
    """Where an object waits beside the table until it is put on it, metres; on an invisible shelf."""
    return _WAITING_M[0] + _WAITING_PITCH_M * index, _WAITING_M[1]


def build_objects(scene: Any, bodies: Sequence[Body], density_kg_m3: float) -> list[Any]:
    """The objects as ManiSkill Actors, the target first."""
    return [_build_object(scene, body, index, density_kg_m3) for index, body in enumerate(bodies)]


def remove_objects(scene: Any, objects: Sequence[Any]) -> None:
    """Take objects out of a scene of the CPU simulation, so that others of the same names can be built."""
    for actor in reversed(objects):  # PhysX then gives the next ones the same places, and so the same results.
        scene.sub_scenes[0].remove_entity(actor._objs[0])  # scene.remove_actor fails in ManiSkill 3.0.1
        scene.remove_from_state_dict_registry(actor)
        del scene.actors[actor.name]


def _build_object(scene: Any, body: Body, index: int, density_kg_m3: float) -> Any:
    """One object as a ManiSkill Actor; index 0 is the target. It waits beside the table until it is placed."""
    builder = scene.create_actor_builder()
    material = _material(scene, TARGET_PAINT if index == 0 else OBSTACLE_PAINTS[index % len(OBSTACLE_PAINTS)])
    half_height = body.height_m / 2
    if body.shape == "cylinder":
        along_z = sapien.Pose(q=[math.sqrt(0.5), 0, math.sqrt(0.5), 0])  # SAPIEN's cylinders lie along x
        can = {"radius": body.half_width_m, "half_length": half_height}
        builder.add_cylinder_collision(along_z, density=density_kg_m3, **can)
        if material is not None:
            builder.add_cylinder_visual(along_z, material=material, **can)
    else:
        half_size = [body.half_width_m, body.half_width_m, half_height]
        builder.add_box_collision(half_size=half_size, density=density_kg_m3)
        if material is not None:
            builder.add_box_visual(half_size=half_size, material=material)
    builder.initial_pose = sapien.Pose(p=[*waiting_xy(index), half_height])
    return builder.build(name="target" if index == 0 else f"obstacle{index}")


def _material(scene: Any, colour: Colour) -> Any:
    """A material, or None where nothing can render: SAPIEN fails to make one there."""
    if not scene.can_render():
        return None
    return sapien.render.RenderMaterial(base_color=list(colour), roughness=0.6, specular=0.3)


def _slab(
    scene: Any, name: str, half: Sequence[float], centre: Sequence[float], colour: Colour, *,
    solid: bool = True, seen: bool = True,
) -> None:  # fmt: skip
    builder = scene.create_actor_builder()
    if solid:
        builder.add_box_collision(half_size=half)
    if seen and scene.can_render():
        builder.add_box_visual(half_size=half, material=_material(scene, colour))
    builder.initial_pose = sapien.Pose(p=centre)
    builder.build_static(name=name)


def _draw_cells(scene: Any, centres: np.ndarray, half: float) -> None:
    """A square outline about every cell, whatever the layout; neighbours share a line."""
    builder, material = scene.create_actor_builder(), _material(scene, _LINE)
    lines = {
        (round(x + dx, 6), round(y + dy, 6), dx != 0)
        for x, y in centres.tolist()
        for dx, dy in ((half, 0), (-half, 0), (0, half), (0, -half))
    }
    for x, y, across in sorted(lines):
        size = [_LINE_HALF_M, half + _LINE_HALF_M, 0.0004]
        size = size if across else [size[1], size[0], size[2]]
        builder.add_box_visual(sapien.Pose(p=[x, y, 0.0004]), half_size=size, material=material)
    builder.initial_pose = sapien.Pose()
    builder.build_static(name="cells")
