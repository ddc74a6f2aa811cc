"""Kinova's Jaco of the second generation with three fingers, j2n6s300, with the meshes of dm_control or a URDF's."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from xml.etree import ElementTree

from dore.errors import InputError
from dore.sim.config import ArmModel, Description
from dore.sim.scene.jaco_urdf import NAME, jaco_urdf

_WANTED = "want the path of kinova_description's j2n6s300 URDF, expanded by xacro"
_HAND = f"{NAME}_link_6"
_TOOL = f"{NAME}_grasp_point"
"""Our own frame, y from finger 1 to fingers 2 and 3: the end effector's is turned by 90 degrees in some versions."""
_TOOL_XYZ, _TOOL_RPY = "0 0 -0.16", "3.141592653589793 0 0"
_LIMITS = {"2": (0.8203, 5.4629), "3": (0.3316, 5.9516)}
"""Radians (47 to 313 and 19 to 341 degrees): some versions call these two joints continuous."""
_TURN = 6.2832
_MESHES = {
    "base": "base", "1": "shoulder", "2": "arm", "3": "forearm", "4": "wrist", "5": "wrist", "6": "hand_3finger",
    "finger": "finger_proximal", "finger_tip": "finger_distal",
}  # fmt: skip
_FINGERS, _TIPS = ([f"{NAME}_joint_finger_{part}{i}" for i in (1, 2, 3)] for part in ("", "tip_"))
_FINGER_LINKS = [(f"{NAME}_link_finger_{i}", f"{NAME}_link_finger_tip_{i}") for i in (1, 2, 3)]


def jaco() -> ArmModel:
    """The arm with its three fingers half open, which suits a can: wide open they stick out by 10 cm."""
    return ArmModel(
        name="jaco",
        describe=_describe,
        joints=tuple(f"{NAME}_joint_{i}" for i in range(1, 7)),
        ready_seed=(0.36, 2.86, 5.87, -0.17, 1.75, 2.56),  # elbow up
        held_joints=(),
        acceleration=(4.0, 4.0, 4.0, 6.0, 6.0, 6.0),  # not published; chosen: full speed within 0.2 s
        arm_drive=(4e3, 4e2, 200.0),
        finger_drive=(40.0, 4.0, 4.0),
        tool_link=_TOOL,
        half_opening_m=0.047,
        fingers={**dict.fromkeys(_FINGERS, (0.30, 1.20)), **dict.fromkeys(_TIPS, (0.60, 0.80))},
        hand_links=(_HAND, *(link for links in _FINGER_LINKS for link in links)),
        jaws=(_FINGER_LINKS[0], (*_FINGER_LINKS[1], *_FINGER_LINKS[2])),
        parts={
            f"{NAME}_link_base": "base", f"{NAME}_link_1": "shoulder",
            f"{NAME}_link_2": "upper arm", f"{NAME}_link_3": "forearm", f"{NAME}_link_4": "wrist",
            f"{NAME}_link_5": "wrist", _HAND: "hand",
            **{link: f"finger {i}" for i, links in enumerate(_FINGER_LINKS, 1) for link in links},
        },
    )  # fmt: skip


def _describe(urdf: str | None) -> Description:
    """The user's file, or one about dm_control's meshes; with a grasp point, and limits for continuous joints.

    Raises:
        InputError: no dm_control; a file that is missing, no URDF, of another arm, or without its meshes beside it.
    """
    root = ElementTree.fromstring(jaco_urdf(_kinovas_mesh)) if urdf is None else _users(urdf)
    for joint in root.findall("joint"):
        _bound(joint)
    if any(link.get("name") == _HAND for link in root.findall("link")):
        _add_tool(root)
    return Description(ElementTree.tostring(root, encoding="unicode"))


def _kinovas_mesh(link: str) -> str:
    """A link's mesh in the installed dm_control, which is found without importing it, nor MuJoCo with it.

    Raises:
        InputError: not there.
    """
    spec = importlib.util.find_spec("dm_control")
    folder = Path(spec.origin).parent / "third_party/kinova/meshes_decimated" if spec and spec.origin else None
    path = folder / f"{_MESHES[link]}.stl" if folder else None
    if path is None or not path.is_file():
        raise InputError("arm=jaco: no meshes, want Kinova's: pip install '.[jaco]'; or arm.urdf=, a URDF of yours")
    return f'<geometry><mesh filename="{path.as_posix()}"/></geometry>'


def _users(path: str) -> ElementTree.Element:
    """The user's file with absolute mesh paths.

    Raises:
        InputError: missing, not a URDF, or without its meshes beside it.
    """
    try:
        root = ElementTree.fromstring(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"arm.urdf: {path}: {error.strerror}; {_WANTED}") from None
    except (UnicodeDecodeError, ElementTree.ParseError) as error:
        raise InputError(f"arm.urdf: {path}: no XML ({error}); {_WANTED}") from None
    if root.tag != "robot":
        raise InputError(f"arm.urdf: {path}: begins with <{root.tag}>, not <robot>; {_WANTED}")
    for tag in ("transmission", "gazebo"):
        for element in root.findall(tag):
            root.remove(element)
    for mesh in root.iter("mesh"):
        mesh.set("filename", _mesh(mesh.get("filename", ""), Path(path)))
    return root


def _mesh(name: str, urdf: Path) -> str:
    """The absolute path of a mesh; a ROS package is looked for among the folders above the URDF.

    Raises:
        InputError: no such file.
    """
    inside, above = name.removeprefix("file://"), urdf.resolve().parents
    if inside.startswith("package://"):
        package, _, inside = inside.removeprefix("package://").partition("/")
        tried = [folder / inside for folder in above if folder.name == package]
        tried += [folder / package / inside for folder in above]
    else:
        tried = [above[0] / inside]
    for path in tried:
        if path.is_file():
            return path.as_posix()
    raise InputError(
        f"arm.urdf: {urdf}: no mesh {name}; want it in kinova_description, which the URDF lies in or beside"
    )


def _bound(joint: ElementTree.Element) -> None:
    """Give a continuous joint limits: Pinocchio needs them for a joint with one coordinate."""
    if joint.get("type") != "continuous":
        return
    joint.set("type", "revolute")
    limit = joint.find("limit")
    limit = ElementTree.SubElement(joint, "limit", effort="40", velocity="0.628") if limit is None else limit
    lower, upper = _LIMITS.get(joint.get("name", "").removeprefix(f"{NAME}_joint_"), (-_TURN, _TURN))
    limit.set("lower", str(lower))
    limit.set("upper", str(upper))


def _add_tool(root: ElementTree.Element) -> None:
    ElementTree.SubElement(root, "link", name=_TOOL)
    joint = ElementTree.SubElement(root, "joint", name=f"{_TOOL}_joint", type="fixed")
    for tag, attributes in (
        ("parent", {"link": _HAND}),
        ("child", {"link": _TOOL}),
        ("origin", {"xyz": _TOOL_XYZ, "rpy": _TOOL_RPY}),
    ):
        ElementTree.SubElement(joint, tag, attributes)
