"""A small j2n6s300: the description in the package with plain shapes in place of Kinova's meshes."""

from __future__ import annotations

import math

from dore.sim.scene import jaco_urdf as kinova

_CYLINDERS = {
    # link: radius, length, centre, roll: cylinders along z before the roll
    "base": (0.045, 0.157, "0 0 0.0785", 0.0),
    "1": (0.04, 0.115, "0 0 -0.06", 0.0),
    "2": (0.035, 0.40, "0 -0.205 0", math.pi / 2),
    "3": (0.03, 0.20, "0 0.104 -0.006", math.pi / 2),
    "4": (0.03, 0.07, "0 -0.0185 -0.032", -math.pi / 6),
    "5": (0.03, 0.07, "0 -0.0185 -0.032", -math.pi / 6),
    "6": (0.038, 0.10, "0 0 -0.055", 0.0),
}
_BOXES = {"finger": ("0.044 0.018 0.02", "0.022 -0.0015 0"), "finger_tip": ("0.042 0.018 0.02", "0.021 0 0")}


def jaco_urdf() -> str:
    """The URDF text."""
    return kinova.jaco_urdf(_shape)


def _shape(link: str) -> str:
    if link in _BOXES:
        size, centre = _BOXES[link]
        return f'<origin xyz="{centre}"/><geometry><box size="{size}"/></geometry>'
    radius, length, centre, roll = _CYLINDERS[link]
    shape = f'<cylinder radius="{radius}" length="{length}"/>'
    return f'<origin xyz="{centre}" rpy="{roll} 0 0"/><geometry>{shape}</geometry>'
