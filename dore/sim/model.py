"""What one arm is and another is not, as data: names, branch, limits, fingers. No heavy imports."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Description:
    """An arm's URDF text, its meshes' paths absolute. srdf: which links may touch; None: not known."""

    urdf: str
    srdf: str | None = None


@dataclass(frozen=True)
class ArmModel:
    """One arm with its hand. `conf/arm` names the function that makes it; a new arm is such a function and a YAML.

    name: also ManiSkill's uid.
    describe: the description, from the path that the user gives (`arm.urdf`), or None where none is wanted.
    joints: the arm's joints from the base on, without the fingers.
    ready_seed: joint angles (radians) where the search for the ready posture starts: they name the joint branch.
    held_joints: stay at the seed's angle, so that an arm of seven joints has one posture for a pose.
    acceleration: limits of the joints, rad/s^2. Their speed limits are the URDF's.
    arm_drive, finger_drive: stiffness, damping and largest force of each simulated joint, N m/rad, N m s/rad, N m
        (with metres for the joints that slide).
    tool_link: the grasp point's frame, z forward, y across the jaws.
    half_opening_m: from the grasp point to the open fingers of either side, metres.
    fingers: joint to its angle or way (open, closed), closed a little further than the joint goes, so that it
        presses; all of them follow the first.
    hand_links: palm and fingers, what the width of the open hand is measured on.
    jaws: the links of either side; a held object is pressed by both.
    parts: link to what people call it.
    """

    name: str
    describe: Callable[[str | None], Description]
    joints: tuple[str, ...]
    ready_seed: tuple[float, ...]
    held_joints: tuple[str, ...]
    acceleration: tuple[float, ...]
    arm_drive: tuple[float, float, float]
    finger_drive: tuple[float, float, float]
    tool_link: str
    half_opening_m: float
    fingers: Mapping[str, tuple[float, float]]
    hand_links: tuple[str, ...]
    jaws: tuple[tuple[str, ...], tuple[str, ...]]
    parts: Mapping[str, str]
