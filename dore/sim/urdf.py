"""An arm's URDF, checked and kept in the user's cache, where the simulator and the kinematics read it."""

from __future__ import annotations

import hashlib
import os
import re
import tempfile
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

from dore.errors import InputError
from dore.files import atomic_write
from dore.sim.config import ArmConfig, preset


def arm_files(visuals: bool, arm: ArmConfig | None = None) -> Path:
    """The URDF file of an arm, written if it is not there; its SRDF, where it has one, lies beside it.

    arm: None: the Panda with the slim hand.
    visuals: False leaves out the visual shapes: SAPIEN builds a RenderMaterial for each, which fails where nothing can
        render.

    Raises:
        InputError: `arm.urdf` is missing, unreadable or of another arm.
        ModuleNotFoundError, RuntimeError: ManiSkill, the source of the Panda, is missing or another version.
    """
    arm = arm or preset("arm/panda_slim")
    description = arm.model.describe(arm.urdf)
    urdf, srdf = description.urdf, description.srdf
    _check(urdf, arm)
    if not visuals:
        urdf = re.sub(r"<visual\b.*?</visual>", "", urdf, flags=re.S)
    # Named by content: two environments, or a newer description, never read each other's file.
    home = _cache_folder() / hashlib.sha256((urdf + (srdf or "")).encode()).hexdigest()[:16]
    home.mkdir(exist_ok=True)
    name = arm.model.name
    for suffix, text in ((".srdf", srdf), (".urdf", urdf)):
        if text is not None and not (home / f"{name}{suffix}").exists():
            with atomic_write(home / f"{name}{suffix}") as file:
                file.write(text)
    return home / f"{name}.urdf"


def _check(urdf: str, arm: ArmConfig) -> None:
    """Refuse a description that lacks a joint or link that the arm's model names."""
    root, model = ElementTree.fromstring(urdf), arm.model
    joints = {joint.get("name") for joint in root.findall("joint")}
    links = {link.get("name") for link in root.findall("link")}
    wanted_links = {model.tool_link, *model.hand_links, *model.jaws[0], *model.jaws[1]}
    missing = sorted({*model.joints, *model.fingers} - joints) + sorted(wanted_links - links)
    if missing:
        more = f" and {len(missing) - 2} more" if len(missing) > 2 else ""
        raise InputError(
            f"arm.urdf: {arm.urdf}: no joint or link {', '.join(missing[:2])}{more}; want the description of the arm "
            f"that arm={model.name} names"
        )


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
