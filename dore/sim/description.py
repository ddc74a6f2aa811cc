"""The slim-handed Panda's URDF, made from ManiSkill's own Panda and kept in the user's cache. No heavy imports."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import re
import tempfile
from functools import cache
from pathlib import Path

from dore.errors import atomic_write

ARM_JOINTS = tuple(f"panda_joint{i}" for i in range(1, 8))
TOOL_LINK = "panda_hand_tcp"
FINGER_OPEN_M = 0.04
"""How far each finger opens from the middle, metres."""
HAND_HALF_WIDTH_M = FINGER_OPEN_M + 0.012
"""Half the width of the open hand: finger travel and pad thickness, metres; the palm is 2 mm narrower."""

# The stock hand is 20 cm wide and cannot pass between neighbours of 12 cm cells. This one has a 10 cm palm and
# plain 12 mm fingers, 3 cm longer, so that the tilted palm clears the top of what it grasps. It is no product.
_PALM = (
    ("box", "0 0 0.046", "0.056 0.100 0.034", "0.22 0.23 0.26 1"),
    ("cylinder", "0 0 0.015", "0.036 0.03", "0.9 0.9 0.9 1"),
)
_FINGER_SIZE, _FINGER_COLOUR = "0.022 0.012 0.090", "0.12 0.12 0.13 1"
_STOCK_TOOL, _SLIM_TOOL = 'xyz="0 0 0.1034"', 'xyz="0 0 0.1334"'


def _panda_folder() -> Path:
    """Where the installed ManiSkill keeps its Panda; found without importing it."""
    spec = importlib.util.find_spec("mani_skill")
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError("mani_skill is not installed; the simulated arm needs it: pip install mani-skill")
    return Path(spec.origin).parent / "assets" / "robots" / "panda"


def _shape(tag: str, kind: str, xyz: str, size: str, colour: str) -> str:
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


def slim_urdf(stock: str, meshes_under: Path) -> str:
    """The slim-handed arm's URDF text, from the stock one's; mesh paths become absolute below `meshes_under`.

    Raises:
        RuntimeError: the stock text lacks what is to be replaced (another ManiSkill).
    """
    palm = "".join(_shape(tag, *part) for tag in ("visual", "collision") for part in _PALM)
    urdf = _replace_link(stock, "panda_hand", palm + _inertial("0 0 0.03", "0.6", "0.001", "0.0015", "0.001"))
    for side, y in (("left", 0.006), ("right", -0.006)):
        finger = "".join(
            _shape(tag, "box", f"0 {y} 0.041", _FINGER_SIZE, _FINGER_COLOUR) for tag in ("visual", "collision")
        )
        finger += _inertial("0 0 0.02", "0.03", "1e-5", "1e-5", "1e-6")
        urdf = _replace_link(urdf, f"panda_{side}finger", finger)
    if _STOCK_TOOL not in urdf:
        raise RuntimeError("the installed ManiSkill's panda_v2.urdf has no tool frame at 0.1034 m")
    urdf = urdf.replace(_STOCK_TOOL, _SLIM_TOOL)
    return urdf.replace('filename="franka_description', f'filename="{meshes_under.as_posix()}/franka_description')


def _cache_folder() -> Path:
    """A folder of this user that can be written; a temporary one where the home folder cannot."""
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "dore"
    try:
        root.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=root):
            return root
    except OSError:
        return _temporary_folder()


@cache
def _temporary_folder() -> Path:
    return Path(tempfile.mkdtemp(prefix="dore-"))


def arm_files(visuals: bool) -> Path:
    """The URDF file of the slim-handed arm, written if it is not there; its SRDF lies beside it.

    visuals: False leaves out everything that is only seen: SAPIEN builds a RenderMaterial for each, which fails
        where nothing can render.

    Raises:
        ModuleNotFoundError: ManiSkill is not installed.
        RuntimeError: its Panda is not the one that this was written for.
    """
    folder = _panda_folder()
    urdf = slim_urdf((folder / "panda_v2.urdf").read_text(), folder)
    if not visuals:
        urdf = re.sub(r"<visual>.*?</visual>", "", urdf, flags=re.S)
    srdf = (folder / "panda_v2.srdf").read_text()
    # Named by content: two environments, or a newer ManiSkill, never read each other's file.
    home = _cache_folder() / hashlib.sha256((urdf + srdf).encode()).hexdigest()[:16]
    home.mkdir(exist_ok=True)
    for name, text in (("panda_slim.srdf", srdf), ("panda_slim.urdf", urdf)):
        if not (home / name).exists():
            with atomic_write(home / name) as file:
                file.write(text)
    return home / "panda_slim.urdf"
