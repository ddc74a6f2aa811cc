"""A small j2n6s300: the joints of kinova_description (BSD), with plain shapes in place of its meshes."""

from __future__ import annotations

import math

_PI = math.pi
_WRIST = "0 -0.03703 -0.06414"
_JOINTS = (
    # child, kind, origin, roll-pitch-yaw, lower, upper, degrees a second
    ("1", "continuous", "0 0 0.15675", (0, _PI, 0), None, None, 36),
    ("2", "revolute", "0 0.0016 -0.11875", (-_PI / 2, 0, _PI), 0.8203, 5.4629, 36),
    ("3", "revolute", "0 -0.410 0", (0, _PI, 0), 0.3316, 5.9516, 36),
    ("4", "continuous", "0 0.2073 -0.0114", (-_PI / 2, 0, _PI), None, None, 48),
    ("5", "continuous", _WRIST, (_PI / 3, 0, _PI), None, None, 48),
    ("6", "continuous", _WRIST, (_PI / 3, 0, _PI), None, None, 48),
)
_SHAPES = {
    # link: radius, length, centre, roll: cylinders along z before the roll
    "base": (0.045, 0.157, "0 0 0.0785", 0.0),
    "1": (0.04, 0.115, "0 0 -0.06", 0.0),
    "2": (0.035, 0.40, "0 -0.205 0", _PI / 2),
    "3": (0.03, 0.20, "0 0.104 -0.006", _PI / 2),
    "4": (0.03, 0.07, "0 -0.0185 -0.032", -_PI / 6),
    "5": (0.03, 0.07, "0 -0.0185 -0.032", -_PI / 6),
    "6": (0.038, 0.10, "0 0 -0.055", 0.0),
}
_FINGERS = (
    ("0.00279 0.03126 -0.11467", 1.35961148639407),
    ("0.02226 -0.02707 -0.11482", -1.38614049188413),
    ("-0.02226 -0.02707 -0.11482", -1.75545216211587),
)
_INERTIAL = (
    '<inertial><origin xyz="{centre}"/><mass value="{mass}"/>'
    '<inertia ixx="{i}" ixy="0" ixz="0" iyy="{i}" iyz="0" izz="{i}"/></inertial>'
)


def jaco_urdf() -> str:
    """The URDF text."""
    parts = ['<robot name="j2n6s300">', '<link name="root"/>', _fixed("joint_base", "root", "link_base", "0 0 0", 0.0)]
    for name, (radius, length, centre, roll) in _SHAPES.items():
        shape = f'<cylinder radius="{radius}" length="{length}"/>'
        parts.append(_link(f"link_{name}", shape, centre, roll, mass=0.6))
    parent = "link_base"
    for number, kind, xyz, rpy, lower, upper, speed in _JOINTS:
        bounds = "" if lower is None else f'lower="{lower}" upper="{upper}" '
        limit = f'<limit {bounds}effort="40" velocity="{math.radians(speed)}"/>'
        parts.append(_joint(f"joint_{number}", kind, parent, f"link_{number}", xyz, rpy, limit))
        parent = f"link_{number}"
    parts += ['<link name="j2n6s300_end_effector"/>']
    parts += [_fixed("end_effector_offset", "link_6", "end_effector", "0 0 -0.1600", _PI)]
    for number, (xyz, yaw) in enumerate(_FINGERS, 1):
        box = '<box size="{} 0.018 0.02"/>'
        parts.append(_link(f"link_finger_{number}", box.format(0.044), "0.022 -0.0015 0", 0.0, mass=0.03))
        parts.append(_link(f"link_finger_tip_{number}", box.format(0.042), "0.021 0 0", 0.0, mass=0.03))
        finger, tip = f"link_finger_{number}", f"link_finger_tip_{number}"
        rpy, limit = (-1.570796327, 0.649262481663582, yaw), '<limit lower="0" upper="{}" effort="2" velocity="1"/>'
        parts.append(_joint(f"joint_finger_{number}", "revolute", "link_6", finger, xyz, rpy, limit.format(1.51)))
        name = f"joint_finger_tip_{number}"
        parts.append(_joint(name, "revolute", finger, tip, "0.044 -0.003 0", (0, 0, 0), limit.format(2)))
    return "\n".join([*parts, "</robot>", ""])


def _link(name: str, shape: str, centre: str, roll: float, mass: float) -> str:
    body = f'<origin xyz="{centre}" rpy="{roll} 0 0"/><geometry>{shape}</geometry>'
    inertial = _INERTIAL.format(centre=centre, mass=mass, i=1e-3 * mass)
    return f'<link name="j2n6s300_{name}"><visual>{body}</visual><collision>{body}</collision>{inertial}</link>'


def _joint(name: str, kind: str, parent: str, child: str, xyz: str, rpy: tuple[float, float, float], limit: str) -> str:
    turned = " ".join(map(str, rpy))
    return (
        f'<joint name="j2n6s300_{name}" type="{kind}"><parent link="j2n6s300_{parent}"/>'
        f'<child link="j2n6s300_{child}"/><axis xyz="0 0 1"/>{limit}<origin xyz="{xyz}" rpy="{turned}"/></joint>'
    )


def _fixed(name: str, parent: str, child: str, xyz: str, roll: float) -> str:
    parent = parent if parent == "root" else f"j2n6s300_{parent}"
    return (
        f'<joint name="j2n6s300_{name}" type="fixed"><parent link="{parent}"/><child link="j2n6s300_{child}"/>'
        f'<origin xyz="{xyz}" rpy="{roll} 0 0"/></joint>'
    )
