"""Franka's Panda from the installed ManiSkill, with its own hand or with a slim one. No heavy imports."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

from dore.errors import InputError
from dore.sim.config import ArmModel, Description

_JOINTS = tuple(f"panda_joint{i}" for i in range(1, 8))
_FINGER_OPEN_M = 0.04
"""How far each finger opens from the middle, metres."""
_FINGER_CLOSED_M = -0.01
"""Commanded to close: beyond what the fingers reach, so that they press on thin objects too, as ManiSkill does."""

# The stock hand is 21 cm wide and cannot pass between neighbours of 12 cm cells. This one has a 10 cm palm and
# plain 12 mm fingers, 3 cm longer, so that the tilted palm clears the top of what it grasps. Not a commercial hand.
_PALM = (
    ("box", "0 0 0.046", "0.056 0.100 0.034", "0.22 0.23 0.26 1"),
    ("cylinder", "0 0 0.015", "0.036 0.03", "0.9 0.9 0.9 1"),
)
_FINGER_SIZE, _FINGER_COLOUR = "0.022 0.012 0.090", "0.12 0.12 0.13 1"
_STOCK_TOOL, _SLIM_TOOL = 'xyz="0 0 0.1034"', 'xyz="0 0 0.1334"'


def panda() -> ArmModel:
    """The arm with its own hand."""
    return ArmModel(
        name="panda",
        describe=_stock,
        joints=_JOINTS,
        # Elbow up, hand ahead. Joint 3 stays at zero, so the elbow stays in the vertical plane through the wrist and
        # the joints of a pose are unique. Drawing all joints to a home posture instead jumps between two elbows.
        ready_seed=(0.0, -0.8, 0.0, -2.6, 0.0, 2.7, 0.785),
        held_joints=("panda_joint3",),
        acceleration=(15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0),  # published by Franka Emika
        arm_drive=(1e3, 1e2, 100.0),  # these six are ManiSkill's
        finger_drive=(1e3, 1e2, 100.0),
        tool_link="panda_hand_tcp",
        half_opening_m=_FINGER_OPEN_M,
        fingers={f"panda_finger_joint{i}": (_FINGER_OPEN_M, _FINGER_CLOSED_M) for i in (1, 2)},
        hand_links=("panda_hand", "panda_leftfinger", "panda_rightfinger"),
        jaws=(("panda_leftfinger",), ("panda_rightfinger",)),
        parts={
            "panda_link0": "base", "panda_link1": "shoulder", "panda_link2": "shoulder",
            "panda_link3": "upper arm", "panda_link4": "elbow", "panda_link5": "forearm", "panda_link6": "wrist",
            "panda_link7": "wrist", "panda_hand": "hand", "panda_leftfinger": "left finger",
            "panda_rightfinger": "right finger",
        },
    )  # fmt: skip


def panda_slim() -> ArmModel:
    """The arm with a 10 cm palm and plain 12 mm fingers in place of its hand; not a product."""
    return ArmModel(**{**vars(panda()), "name": "panda_slim", "describe": _slim})


def slim_urdf(stock: str) -> str:
    """The slim-handed arm's URDF text, from the stock one's.

    Raises:
        RuntimeError: the stock text lacks what is to be replaced (another ManiSkill).
    """
    palm = "".join(_shape_xml(tag, *part) for tag in ("visual", "collision") for part in _PALM)
    urdf = _replace_link(stock, "panda_hand", palm + _inertial("0 0 0.03", "0.6", "0.001", "0.0015", "0.001"))
    for side, y in (("left", 0.006), ("right", -0.006)):
        finger = "".join(
            _shape_xml(tag, "box", f"0 {y} 0.041", _FINGER_SIZE, _FINGER_COLOUR) for tag in ("visual", "collision")
        )
        finger += _inertial("0 0 0.02", "0.03", "1e-5", "1e-5", "1e-6")
        urdf = _replace_link(urdf, f"panda_{side}finger", finger)
    if _STOCK_TOOL not in urdf:
        raise RuntimeError("the installed ManiSkill's panda_v2.urdf has no tool frame at 0.1034 m")
    return urdf.replace(_STOCK_TOOL, _SLIM_TOOL)


def _stock(urdf: str | None) -> Description:
    """ManiSkill's own description.

    Raises:
        InputError: the user gave a URDF.
        ModuleNotFoundError: ManiSkill is not installed.
    """
    if urdf is not None:
        raise InputError(f"arm.urdf: got {urdf!r}, want null: the Panda's description is the installed ManiSkill's")
    spec = importlib.util.find_spec("mani_skill")  # found without importing it
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError("mani_skill is not installed; the simulated arm needs it: pip install mani-skill")
    folder = Path(spec.origin).parent / "assets" / "robots" / "panda"
    text = (folder / "panda_v2.urdf").read_text()
    text = text.replace('filename="franka_description', f'filename="{folder.as_posix()}/franka_description')
    return Description(text, (folder / "panda_v2.srdf").read_text())


def _slim(urdf: str | None) -> Description:
    stock = _stock(urdf)
    return Description(slim_urdf(stock.urdf), stock.srdf)


def _shape_xml(tag: str, kind: str, xyz: str, size: str, colour: str) -> str:
    if kind == "box":
        geometry = f'<box size="{size}"/>'
    else:
        radius, length = size.split()
        geometry = f'<cylinder radius="{radius}" length="{length}"/>'
    name = colour.replace(" ", "_")
    material = f'<material name="c{name}"><color rgba="{colour}"/></material>' if tag == "visual" else ""
    return f'<{tag}><origin rpy="0 0 0" xyz="{xyz}"/><geometry>{geometry}</geometry>{material}</{tag}>'


def _inertial(xyz: str, mass: str, xx: str, yy: str, zz: str) -> str:
    inertia = f'<inertia ixx="{xx}" ixy="0" ixz="0" iyy="{yy}" iyz="0" izz="{zz}"/>'
    return f'<inertial><origin rpy="0 0 0" xyz="{xyz}"/><mass value="{mass}"/>{inertia}</inertial>'


def _replace_link(urdf: str, name: str, body: str) -> str:
    new, count = re.subn(rf'<link name="{name}">.*?</link>', f'<link name="{name}">{body}</link>', urdf, flags=re.S)
    if count != 1:
        raise RuntimeError(f"the installed ManiSkill's panda_v2.urdf has {count} links {name}, want 1")
    return new
