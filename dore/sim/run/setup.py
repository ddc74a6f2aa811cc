"""What an execution is set up with: arm, objects, camera; the environment and the empty report that they give."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import gymnasium as gym
import numpy as np

from dore.errors import InputError, flag, number, seed_of
from dore.sim.camera_config import CameraConfig
from dore.sim.config import ArmConfig, Body, ObjectConfig, ViewConfig
from dore.sim.kinematics import ArmKinematics
from dore.sim.motion.arm_reach import arm_reach
from dore.sim.motion.outcome import Outcome
from dore.sim.run.report import ExecutionReport
from dore.sim.scene.agent import NO_DRIVER, render_backend
from dore.sim.urdf import arm_files
from dore.world.layout import Layout
from dore.world.problem import Scene, cell_id
from dore.world.reach import Reach

REPORT_NAME, VIDEO_NAME = "execution.json", "execution.mp4"
NO_PICTURES = f"state only, no pictures: {NO_DRIVER}"
CONTROL_S = 0.05
"""Simulated seconds of a control step."""


@dataclass(frozen=True)
class Setup:
    """Arm, objects, the RGB-D camera and the viewpoint of the film.

    jitter_m: objects stand up to this far off the middle of their cells; turned: and turned by any angle.
    seed: of the objects' shapes and of the simulator; the same seed gives the same execution.
    film: whether to make a film if a Vulkan driver exists.

    Raises:
        InputError: an invalid seed, a negative jitter, or objects lower than the grasp.
    """

    arm: ArmConfig
    objects: ObjectConfig
    view: ViewConfig
    camera: CameraConfig
    seed: int
    film: bool
    jitter_m: float = 0.0
    turned: bool = False

    def __post_init__(self) -> None:
        seed_of("seed", self.seed)
        number("jitter_m", self.jitter_m, above=-1e-12, at_most=0.05)
        flag("turned", self.turned)
        lowest, grasp = self.objects.height_m[0], self.arm.grasp_height_m
        if lowest <= grasp:
            raise InputError(f"objects.height_m: from {lowest:g}, want more than arm.grasp_height_m {grasp:g}")

    def bodies(self, count: int) -> tuple[Body, ...]:
        """`count` objects, the target first."""
        return self.objects.draw(count, np.random.default_rng(self.seed))

    def placing(self, scene: Scene) -> dict[str, Any]:
        """Options of the environment's reset: where the scene's objects stand, the target first."""
        cells, rng = [scene.target, *scene.obstacles], np.random.default_rng([self.seed, 1])
        angle, far = rng.uniform(0, 2 * np.pi, len(cells)), self.jitter_m * np.sqrt(rng.uniform(size=len(cells)))
        yaws = rng.uniform(-np.pi / 4, np.pi / 4, len(cells)) if self.turned else np.zeros(len(cells))
        return {
            "cells": cells, "offsets_m": np.column_stack([far * np.cos(angle), far * np.sin(angle)]), "yaws_rad": yaws,
        }  # fmt: skip

    @cached_property
    def kinematics(self) -> ArmKinematics:
        """The arm's, built once.

        Raises:
            InputError: its description is missing or wrong.
        """
        return ArmKinematics(arm_files(visuals=False, arm=self.arm), self.arm)

    def reseeded(self, seed: int) -> Setup:
        """The same with another seed; both share the kinematics."""
        other = replace(self, seed=seed)
        vars(other)["kinematics"] = self.kinematics
        return other

    def reach(self, layout: Layout) -> Reach:
        """What the arm can do among these objects on a layout; plans have to be made with it.

        Raises:
            InputError: the arm's description is missing or wrong.
        """
        return arm_reach(self.arm, self.objects, layout, self.kinematics)

    def report(self, scene: Scene, bodies: tuple[Body, ...], planner: str) -> ExecutionReport:
        """An empty report; bodies beyond the scene's wait beside the table."""
        cells = (scene.target, *scene.obstacles)
        listed = [
            {"cell": cell_id(cells[i]) if i < len(cells) else None, "target": i == 0, **asdict(body)}
            for i, body in enumerate(bodies)
        ]
        return ExecutionReport(Outcome.INCOMPLETE, "not finished", self.arm.name, self.seed, planner, listed)

    def environment(self, layout: Layout, bodies: tuple[Body, ...], backend: str) -> Any:
        """A `DoreTabletop-v1`, before its reset."""
        return gym.make(
            "DoreTabletop-v1", layout=layout, bodies=bodies, kinematics=self.kinematics, view=self.view,
            camera=self.camera, density_kg_m3=self.objects.density_kg_m3, obs_mode="none", reward_mode="none",
            judge_steps=False, control_mode="pd_joint_pos", sim_backend="physx_cpu", render_backend=backend,
            enable_shadow=self.view.shadows, render_mode=None if backend == "none" else "rgb_array",
        )  # fmt: skip

    def rendering(self, needed: bool) -> tuple[str, str]:
        """The render backend to use, and what to say of the film. needed: render even without a film."""
        backend = render_backend() if self.film or needed else "none"
        if not self.film:
            return backend, "no film asked for"
        return backend, NO_PICTURES if backend == "none" else VIDEO_NAME
