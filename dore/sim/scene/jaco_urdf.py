"""The URDF of Kinova's j2n6s300, written about shapes from elsewhere: its meshes come from another package.

Joints, masses and inertias are those that Kinova publishes in kinova_description.
"""

from __future__ import annotations

import math
from collections.abc import Callable

NAME = "j2n6s300"
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
_FINGERS = (
    ("0.00279 0.03126 -0.11467", 1.35961148639407),
    ("0.02226 -0.02707 -0.11482", -1.38614049188413),
    ("-0.02226 -0.02707 -0.11482", -1.75545216211587),
)
_INERTIALS = {
    # kg, centre of mass in metres, ixx iyy izz in kg m^2
    "base": (0.46784, "0 0 0.1255", (9.51e-4, 9.51e-4, 3.74e-4)),
    "1": (0.7477, "0 -0.002 -0.0605", (1.520e-3, 1.520e-3, 5.98e-4)),
    "2": (0.99, "0 -0.2065 -0.01", (1.0502e-2, 7.92e-4, 1.0502e-2)),
    "3": (0.6763, "0 0.081 -0.0086", (1.420e-3, 3.04e-4, 1.420e-3)),
    "4": (0.426367, "0 -0.037 -0.0642", (7.73e-5, 7.73e-5, 7.73e-5)),
    "5": (0.426367, "0 -0.037 -0.0642", (7.73e-5, 7.73e-5, 7.73e-5)),
    "6": (0.99, "0 0 -0.06", (3.45e-4, 3.45e-4, 5.82e-4)),
    "finger": (0.01, "0.022 0 0", (7.9e-7, 7.9e-7, 8e-8)),
}


def jaco_urdf(shape: Callable[[str], str]) -> str:
    """The URDF's text.

    shape: of a link (`base`, `1` to `6`, `finger`, `finger_tip`), its <geometry>, with its <origin> before it if any.
    """
    parts = [f'<robot name="{NAME}">', '<link name="root"/>', _fixed("joint_base", "root", "link_base", "0 0 0", 0.0)]
    parts += [_link(f"link_{name}", shape(name), name) for name in ("base", *(joint[0] for joint in _JOINTS))]
    parent = "link_base"
    for name, kind, xyz, rpy, lower, upper, speed in _JOINTS:
        bounds = "" if lower is None else f'lower="{lower}" upper="{upper}" '
        limit = f'<limit {bounds}effort="40" velocity="{math.radians(speed)}"/>'
        parts.append(_joint(f"joint_{name}", kind, parent, f"link_{name}", xyz, rpy, limit))
        parent = f"link_{name}"
    parts += [f'<link name="{NAME}_end_effector"/>']
    parts += [_fixed("end_effector_offset", "link_6", "end_effector", "0 0 -0.1600", _PI)]
    for number, (xyz, yaw) in enumerate(_FINGERS, 1):
        finger, tip = f"link_finger_{number}", f"link_finger_tip_{number}"
        parts += [_link(finger, shape("finger"), "finger"), _link(tip, shape("finger_tip"), "finger")]
        turned, bent = (-1.570796327, 0.649262481663582, yaw), '<limit lower="0" upper="{}" effort="2" velocity="1"/>'
        parts.append(_joint(f"joint_finger_{number}", "revolute", "link_6", finger, xyz, turned, bent.format(1.51)))
        name = f"joint_finger_tip_{number}"
        parts.append(_joint(name, "revolute", finger, tip, "0.044 -0.003 0", (0, 0, 0), bent.format(2)))
    return "\n".join([*parts, "</robot>", ""])


def _link(name: str, shape: str, inertial: str) -> str:
    mass, centre, (xx, yy, zz) = _INERTIALS[inertial]
    return (
        f'<link name="{NAME}_{name}"><visual>{shape}</visual><collision>{shape}</collision>'
        f'<inertial><origin xyz="{centre}"/><mass value="{mass}"/>'
        f'<inertia ixx="{xx}" ixy="0" ixz="0" iyy="{yy}" iyz="0" izz="{zz}"/></inertial></link>'
    )


def _joint(name: str, kind: str, parent: str, child: str, xyz: str, rpy: tuple[float, ...], limit: str) -> str:
    turned = " ".join(map(str, rpy))
    return (
        f'<joint name="{NAME}_{name}" type="{kind}"><parent link="{NAME}_{parent}"/>'
        f'<child link="{NAME}_{child}"/><axis xyz="0 0 1"/>{limit}<origin xyz="{xyz}" rpy="{turned}"/></joint>'
    )


def _fixed(name: str, parent: str, child: str, xyz: str, roll: float) -> str:
    parent = parent if parent == "root" else f"{NAME}_{parent}"
    return (
        f'<joint name="{NAME}_{name}" type="fixed"><parent link="{parent}"/><child link="{NAME}_{child}"/>'
        f'<origin xyz="{xyz}" rpy="{roll} 0 0"/></joint>'
    )
