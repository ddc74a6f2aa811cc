"""What an execution stands on: the objects drawn, the environment made, the report begun."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import gymnasium as gym
import numpy as np

from dore.errors import InputError, seed_of
from dore.layout import Layout
from dore.plan import Scene, cell_id
from dore.sim.arm import render_backend
from dore.sim.config import ArmConfig, Body, CameraConfig, ObjectConfig
from dore.sim.description import arm_files
from dore.sim.kinematics import ArmKinematics
from dore.sim.outcome import Outcome
from dore.sim.report import ExecutionReport

REPORT_NAME, VIDEO_NAME = "execution.json", "execution.mp4"
NO_PICTURES = "no Vulkan driver here: state only; for pictures run scripts/install_lavapipe.sh (Debian 12, as root)"
CONTROL_S = 0.05
"""Simulated seconds of a control step."""


@dataclass(frozen=True)
class Stage:
    """Arm, objects and the film's camera.

    seed: of the objects' shapes and of the simulator; the same seed gives the same execution.
    film: whether to make pictures where a Vulkan driver exists.

    Raises:
        InputError: a seed that is none, or objects lower than the grasp.
    """

    arm: ArmConfig
    objects: ObjectConfig
    camera: CameraConfig
    seed: int
    film: bool

    def __post_init__(self) -> None:
        seed_of("seed", self.seed)
        lowest, grasp = self.objects.height_m[0], self.arm.grasp_height_m
        if lowest <= grasp:
            raise InputError(f"objects.height_m: from {lowest:g}, want more than arm.grasp_height_m {grasp:g}")

    def bodies(self, count: int) -> tuple[Body, ...]:
        """So many objects, the target first."""
        return self.objects.draw(count, np.random.default_rng(self.seed))

    def kinematics(self) -> ArmKinematics:
        """The arm's.

        Raises:
            InputError: its description is missing or wrong.
        """
        return ArmKinematics(arm_files(visuals=False, arm=self.arm), self.arm)

    def report(self, scene: Scene, bodies: tuple[Body, ...], planner: str) -> ExecutionReport:
        """One in which nothing has happened yet; bodies beyond the scene's wait beside the table."""
        cells = (scene.target, *scene.obstacles)
        listed = [
            {"cell": cell_id(cells[i]) if i < len(cells) else None, "target": i == 0, **asdict(body)}
            for i, body in enumerate(bodies)
        ]
        return ExecutionReport(Outcome.INCOMPLETE, "not finished", self.arm.name, self.seed, planner, listed)

    def environment(self, layout: Layout, bodies: tuple[Body, ...], backend: str, **more: Any) -> Any:
        """A `DoreTabletop-v1`, before its reset."""
        return gym.make(
            "DoreTabletop-v1", layout=layout, bodies=bodies, arm=self.arm, camera=self.camera,
            density_kg_m3=self.objects.density_kg_m3, obs_mode="none", reward_mode="none",
            control_mode="pd_joint_pos", sim_backend="physx_cpu", render_backend=backend,
            enable_shadow=self.camera.shadows, render_mode=None if backend == "none" else "rgb_array", **more,
        )  # fmt: skip

    def pictures(self) -> tuple[str, str]:
        """The render backend to use, and what to say of the film."""
        if not self.film:
            return "none", "not asked for"
        backend = render_backend()
        return backend, NO_PICTURES if backend == "none" else VIDEO_NAME
