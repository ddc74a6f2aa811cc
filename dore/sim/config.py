"""What the simulated arm, its objects and its camera can be told; each class is a `_target_` in conf/."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from dore.errors import InputError, number, whole

Shapes = Literal["mixed", "cuboid", "cylinder"]


@dataclass(frozen=True)
class ArmConfig:
    """How the Panda with a slim hand stands and moves. The values are explained in conf/arm/panda_slim.yaml.

    Raises:
        InputError: a value that is not finite, or outside what the arm can mean.
    """

    name: str = "panda_slim"
    base_drop_m: float = 0.25
    tilt_deg: float = 50.0
    grasp_height_m: float = 0.10
    lift_m: float = 0.03
    staging_m: float = 0.07
    lateral_limit_m: float = 0.42
    heading_limit_deg: float = 60.0
    hand_speed_m_s: float = 0.40
    lift_speed_m_s: float = 0.10
    joint_speed: float = 0.6
    joint_acceleration: float = 0.6
    clearance_m: float = 0.005
    pushed_m: float = 0.005

    def __post_init__(self) -> None:
        if self.name != "panda_slim":
            raise InputError(f"arm.name: got {self.name!r}, want panda_slim")
        number("arm.base_drop_m", self.base_drop_m, above=-1.0, at_most=1.0)
        number("arm.tilt_deg", self.tilt_deg, above=-1.0, at_most=80.0)
        number("arm.heading_limit_deg", self.heading_limit_deg, above=0.0, at_most=89.0)
        number("arm.joint_speed", self.joint_speed, above=0.0, at_most=1.0)
        number("arm.joint_acceleration", self.joint_acceleration, above=0.0, at_most=1.0)
        number("arm.clearance_m", self.clearance_m, above=-1e-9, at_most=0.1)
        lengths = ("grasp_height_m", "lift_m", "staging_m", "lateral_limit_m", "pushed_m")
        for name in (*lengths, "hand_speed_m_s", "lift_speed_m_s"):
            number(f"arm.{name}", getattr(self, name), above=0.0, at_most=2.0)

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
    """Which objects stand on the table; sizes are drawn evenly from [low, high]. See conf/execute.yaml.

    Raises:
        InputError: an unknown shape, or a range that is upside down or not positive.
    """

    shapes: Shapes = "mixed"
    cuboid_half_width_m: tuple[float, float] = (0.022, 0.025)
    can_radius_m: tuple[float, float] = (0.024, 0.028)
    height_m: tuple[float, float] = (0.14, 0.15)
    density_kg_m3: float = 400.0

    def __post_init__(self) -> None:
        if self.shapes not in get_args(Shapes):
            raise InputError(f"objects.shapes: got {self.shapes!r}, want one of {', '.join(get_args(Shapes))}")
        number("objects.density_kg_m3", self.density_kg_m3, above=0.0)
        for name in ("cuboid_half_width_m", "can_radius_m", "height_m"):
            low, high = _numbers(f"objects.{name}", getattr(self, name), ("low", "high"))
            if not 0 < low <= high <= 1:
                raise InputError(f"objects.{name}: got [{low:g}, {high:g}], want 0 < low <= high <= 1")

    def draw(self, count: int, rng: np.random.Generator) -> tuple[Body, ...]:
        """`count` bodies, of both shapes in turn where `shapes` is mixed; the same generator state, the same ones."""
        return tuple(self._one(index, rng) for index in range(count))

    def _one(self, index: int, rng: np.random.Generator) -> Body:
        round_one = self.shapes == "cylinder" or (self.shapes == "mixed" and index % 2 == 1)
        low, high = self.can_radius_m if round_one else self.cuboid_half_width_m
        half_width, height = float(rng.uniform(low, high)), float(rng.uniform(*self.height_m))
        return Body("cylinder" if round_one else "cuboid", half_width, height)


@dataclass(frozen=True)
class CameraConfig:
    """A fixed camera for the video. See conf/camera/.

    Raises:
        InputError: a size below 16 pixels, a field of view outside (0, 170] degrees, a rate that is not positive.
    """

    eye_m: tuple[float, float, float] = (1.50, -0.95, 0.85)
    look_at_m: tuple[float, float, float] = (0.42, 0.02, 0.12)
    width_px: int = 640
    height_px: int = 480
    field_of_view_deg: float = 38.0
    frames_per_s: float = 10.0
    playback_speed: float = 2.0
    shadows: bool = False

    def __post_init__(self) -> None:
        whole("camera.width_px", self.width_px, 16)
        whole("camera.height_px", self.height_px, 16)
        number("camera.field_of_view_deg", self.field_of_view_deg, above=0.0, at_most=170.0)
        number("camera.frames_per_s", self.frames_per_s, above=0.0, at_most=60.0)
        number("camera.playback_speed", self.playback_speed, above=0.0, at_most=100.0)
        for name in ("eye_m", "look_at_m"):
            _numbers(f"camera.{name}", getattr(self, name), ("x", "y", "z"))
        if list(self.eye_m) == list(self.look_at_m):
            raise InputError(f"camera.eye_m: got {list(self.eye_m)}, the same as camera.look_at_m; want another point")


def _numbers(name: str, values: object, wanted: tuple[str, ...]) -> list[float]:
    """`values` as so many finite floats.

    Raises:
        InputError: it is no list, of another length, or holds something else.
    """
    if not isinstance(values, list | tuple) or len(values) != len(wanted):
        raise InputError(f"{name}: got {values!r}, want [{', '.join(wanted)}]")
    return [number(name, value) for value in values]
