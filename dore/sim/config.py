"""The settings of arm, objects and film, checked. It loads no simulator."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import hydra
import numpy as np
from hydra.errors import InstantiationException
from hydra.utils import instantiate

from dore.errors import InputError, flag, number, path_of, whole
from dore.files import conf_dir
from dore.sim.checks import check_picture, number_list
from dore.world.reach import MAX_SECTORS

Shapes = Literal["mixed", "cuboid", "cylinder"]


@dataclass(frozen=True)
class Description:
    """An arm's URDF text with absolute mesh paths. srdf: which links may touch; None: not known."""

    urdf: str
    srdf: str | None = None


@dataclass(frozen=True)
class ArmModel:
    """One arm with its hand. `conf/arm` names the function that makes it; a new arm is such a function and a YAML.

    name: also ManiSkill's uid.
    describe: the description, from the user's path (`arm.urdf`), or from None where the arm needs none.
    joints: the arm's joints from the base on, without the fingers.
    ready_seed: joint angles (radians) where the search for the ready posture starts: they choose the joint branch.
    held_joints: stay at the seed's angle, so that an arm of seven joints has one posture for a pose.
    acceleration: limits of the joints, rad/s^2. Their speed limits are the URDF's.
    arm_drive, finger_drive: stiffness, damping and largest force of each simulated joint, N m/rad, N m s/rad, N m
        (with metres for the joints that slide).
    tool_link: the grasp point's frame, z forward, y across the jaws.
    half_opening_m: from the grasp point to the open fingers of either side, metres.
    fingers: joint to its position (open, closed), the closed one a little beyond what the joint reaches, so that
        it presses; all of them follow the first.
    hand_links: palm and fingers, from which the width of the open hand is measured.
    jaws: the links of either side; a held object is pressed by both.
    parts: link to its name in messages.
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


@dataclass(frozen=True)
class ArmConfig:
    """Which arm it is, how it stands and how it moves. The values are explained in conf/arm/.

    model: what the arm is. urdf: path of its description, where the user has to give it.

    Raises:
        InputError: a value that is not finite, or out of bounds.
    """

    model: ArmModel
    base_drop_m: float
    tilt_deg: float
    grasp_height_m: float
    lift_m: float
    staging_m: float
    lateral_limit_m: float
    max_yaw_deg: float
    half_fan_deg: float
    n_sectors: int
    corridor_margin_m: float
    hand_speed_m_s: float
    lift_speed_m_s: float
    joint_speed: float
    joint_acceleration: float
    clearance_m: float
    pushed_m: float
    urdf: str | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.model, ArmModel):
            raise InputError(f"arm.model: got {self.model!r}, want a model, as in conf/arm")
        if self.urdf is not None:
            path_of("arm.urdf", self.urdf)
        number("arm.base_drop_m", self.base_drop_m, above=-1.0, at_most=1.0)
        number("arm.tilt_deg", self.tilt_deg, above=-1.0, at_most=80.0)
        number("arm.max_yaw_deg", self.max_yaw_deg, above=0.0, at_most=89.0)
        number("arm.half_fan_deg", self.half_fan_deg, above=0.0, at_most=180.0)
        whole("arm.n_sectors", self.n_sectors, 2, at_most=MAX_SECTORS)
        number("arm.corridor_margin_m", self.corridor_margin_m, above=-1e-9, at_most=1.0)
        for name in ("joint_speed", "joint_acceleration", "hand_speed_m_s", "lift_speed_m_s"):
            # Slower than that a motion takes hours, and its path does not fit into memory.
            number(f"arm.{name}", getattr(self, name), above=0.009, at_most=2.0 if name.endswith("m_s") else 1.0)
        number("arm.clearance_m", self.clearance_m, above=-1e-9, at_most=0.1)
        lengths = ("grasp_height_m", "lift_m", "staging_m", "lateral_limit_m", "pushed_m")
        for name in lengths:
            number(f"arm.{name}", getattr(self, name), above=0.0, at_most=2.0, unit="metres")

    @property
    def name(self) -> str:
        """The model's."""
        return self.model.name

    @property
    def tilt_rad(self) -> float:
        """How far below the horizontal the hand points, radians."""
        return math.radians(self.tilt_deg)


@dataclass(frozen=True)
class Body:
    """One upright object. `half_width_m`: half a cuboid's side, or a can's radius; `height_m`: its whole height."""

    shape: Literal["cuboid", "cylinder"]
    half_width_m: float
    height_m: float

    @property
    def radius_m(self) -> float:
        """Radius of the circle about its footprint, however it is turned, metres."""
        return self.half_width_m * (math.sqrt(2.0) if self.shape == "cuboid" else 1.0)


@dataclass(frozen=True)
class ObjectConfig:
    """Which objects stand on the table; sizes are drawn evenly from [low, high]. See conf/objects.

    Raises:
        InputError: an unknown shape, or a range that is upside down or not positive.
    """

    shapes: Shapes
    cuboid_half_width_m: tuple[float, float]
    can_radius_m: tuple[float, float]
    height_m: tuple[float, float]
    density_kg_m3: float

    def __post_init__(self) -> None:
        if self.shapes not in get_args(Shapes):
            raise InputError(f"objects.shapes: got {self.shapes!r}, want one of {', '.join(get_args(Shapes))}")
        number("objects.density_kg_m3", self.density_kg_m3, above=0.0, at_most=25_000.0)
        for name in ("cuboid_half_width_m", "can_radius_m", "height_m"):
            low, high = number_list(f"objects.{name}", getattr(self, name), ("low", "high"))
            if not 0 < low <= high <= 1:
                raise InputError(f"objects.{name}: got [{low:g}, {high:g}], want 0 < low <= high <= 1")

    @property
    def widest(self) -> Body:
        """A can as wide as the widest object, however it is turned, and as tall as the tallest."""
        kinds = {
            "cuboid": Body("cuboid", self.cuboid_half_width_m[1], self.height_m[1]),
            "cylinder": Body("cylinder", self.can_radius_m[1], self.height_m[1]),
        }
        drawn = kinds.values() if self.shapes == "mixed" else (kinds[self.shapes],)
        return Body("cylinder", max(body.radius_m for body in drawn), self.height_m[1])

    def draw(self, count: int, rng: np.random.Generator) -> tuple[Body, ...]:
        """`count` bodies, of both shapes in turn where `shapes` is mixed; the same generator state, the same ones."""
        return tuple(self._one(index, rng) for index in range(count))

    def _one(self, index: int, rng: np.random.Generator) -> Body:
        round_one = self.shapes == "cylinder" or (self.shapes == "mixed" and index % 2 == 1)
        low, high = self.can_radius_m if round_one else self.cuboid_half_width_m
        half_width, height = float(rng.uniform(low, high)), float(rng.uniform(*self.height_m))
        return Body("cylinder" if round_one else "cuboid", half_width, height)


@dataclass(frozen=True)
class ViewConfig:
    """The viewpoint of the film. See conf/view/.

    Raises:
        InputError: a size below 16 pixels, a field of view outside (0, 170] degrees, a rate that is not positive.
    """

    position_m: tuple[float, float, float]
    look_at_m: tuple[float, float, float]
    width_px: int
    height_px: int
    field_of_view_deg: float
    frames_per_s: float
    playback_speed: float
    shadows: bool

    def __post_init__(self) -> None:
        check_picture("view", self.width_px, self.height_px, self.field_of_view_deg)
        number("view.frames_per_s", self.frames_per_s, above=0.09, at_most=60.0)
        number("view.playback_speed", self.playback_speed, above=0.009, at_most=100.0)
        flag("view.shadows", self.shadows)
        for name in ("position_m", "look_at_m"):
            number_list(f"view.{name}", getattr(self, name), ("x", "y", "z"))
        if list(self.position_m) == list(self.look_at_m):
            raise InputError(
                f"view.position_m: got {list(self.position_m)}, the same as view.look_at_m; want another point"
            )


def preset(name: str, **given: Any) -> Any:
    """The object that an option of conf/ describes, as `arm/panda_slim`: default values are written there alone.

    given: keys with other values.

    Raises:
        InputError: one of these values is refused.
    """
    group, _, option = name.partition("/")
    with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
        node = hydra.compose(overrides=[f"+{group}={option}"])[group]
    try:
        return instantiate(node, _convert_="all", **given)
    except InstantiationException as error:
        if isinstance(error.__cause__, InputError):
            raise error.__cause__ from None
        raise
