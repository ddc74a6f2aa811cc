"""The ManiSkill task `DoreTabletop-v1`: objects in the cells of a table, one of them the target."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import sapien
import torch
from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.sensors.camera import CameraConfig as SensorConfig
from mani_skill.utils import sapien_utils
from mani_skill.utils.registration import register_env
from mani_skill.utils.structs.pose import Pose
from mani_skill.utils.structs.types import SimConfig
from torch import Tensor

from dore.errors import InputError
from dore.layout import Layout
from dore.sim.arm import PandaSlim
from dore.sim.config import ArmConfig, Body, CameraConfig, preset
from dore.sim.description import FINGER_OPEN_M, arm_files
from dore.sim.kinematics import ArmKinematics
from dore.sim.scenery import build_object, build_surroundings

UPRIGHT_DEG = 10.0
"""An object leaning more than this no longer counts as upright."""


@register_env("DoreTabletop-v1", max_episode_steps=100_000)
class DoreTabletopEnv(BaseEnv):
    """Objects stand in the cells of a table before the arm; one of them is the target.

    **Task:** take the target out of the grid and hold it up, with every other object upright in a cell.

    **Randomisation:** which cells the objects stand in, unless `reset(options={"cells": [...]})` names one cell
    per object, the target's first; cells count from 0.

    **Success:** `target_lifted`, `target_out`, `all_upright` and `all_in_cell`, all of them.

    World frame: REP-103 at the robot base's axis; z = 0 is the table top, the base stands below it.

    Args:
        layout: the cells, regular or not; None: 3 x 6 of 12 cm, front edge at 0.50 m.
        bodies: the objects, the target first; None: seven mixed ones of fixed sizes.
        arm: how the arm stands.
        camera: the camera of `render()`.
        density_kg_m3: of the objects.

    Raises:
        InputError: more objects than cells.
    """

    SUPPORTED_ROBOTS = ["panda_slim"]  # noqa: RUF012
    SUPPORTED_REWARD_MODES = ["sparse", "none"]  # noqa: RUF012
    agent: PandaSlim

    def __init__(
        self,
        *args: Any,
        robot_uids: str = "panda_slim",
        layout: Layout | None = None,
        bodies: Sequence[Body] | None = None,
        arm: ArmConfig | None = None,
        camera: CameraConfig | None = None,
        density_kg_m3: float = 400.0,
        **kwargs: Any,
    ) -> None:
        self.layout = layout or Layout.grid(3, 6, 0.12, 0.50)
        self.bodies = tuple(bodies or preset("objects/mixed").draw(7, np.random.default_rng(0)))
        self.arm, self.camera = arm or preset("arm/panda_slim"), camera or preset("camera/corner")
        if len(self.bodies) > self.layout.n_cells:
            raise InputError(f"bodies: {len(self.bodies)} objects, want at most {self.layout.n_cells}, one a cell")
        self.density_kg_m3 = density_kg_m3
        self.objects: list[Any] = []
        kinematics = ArmKinematics(arm_files(visuals=False), self.arm)
        self._ready_joints = kinematics.ready(self.layout.front_m - self.arm.staging_m).joints
        super().__init__(*args, robot_uids=robot_uids, **kwargs)

    @property
    def _default_sim_config(self) -> SimConfig:
        return SimConfig(sim_freq=100, control_freq=20)

    @property
    def _default_sensor_configs(self) -> list[SensorConfig]:
        middle = self.layout.centres.mean(0).tolist()
        pose = sapien_utils.look_at([middle[0] + 0.25, middle[1], 1.0], [middle[0], middle[1], 0.02])
        return [SensorConfig("above", pose, 640, 480, fov=math.radians(50), near=0.01, far=10)]

    @property
    def _default_human_render_camera_configs(self) -> SensorConfig:
        camera = self.camera
        pose = sapien_utils.look_at(list(camera.eye_m), list(camera.look_at_m))
        fov = math.radians(camera.field_of_view_deg)
        return SensorConfig("view", pose, camera.width_px, camera.height_px, fov=fov, near=0.01, far=20)

    def _load_agent(self, options: dict[str, Any]) -> None:
        super()._load_agent(options, sapien.Pose(p=[0, 0, -self.arm.base_drop_m]))

    def _load_lighting(self, options: dict[str, Any]) -> None:
        self.scene.set_ambient_light([0.35, 0.35, 0.36])
        self.scene.add_directional_light(
            [-0.6, 0.12, -1.0], [1.4, 1.35, 1.3], shadow=self.enable_shadow, shadow_scale=2.0, shadow_map_size=2048
        )
        self.scene.add_directional_light([-0.4, 0.8, -0.5], [0.4, 0.42, 0.46])

    def _load_scene(self, options: dict[str, Any]) -> None:
        build_surroundings(self.scene, self.layout, self.arm.base_drop_m)
        self.objects = [
            build_object(self.scene, body, index, self.density_kg_m3) for index, body in enumerate(self.bodies)
        ]

    def _initialize_episode(self, env_idx: Tensor, options: dict[str, Any]) -> None:
        count = len(env_idx)
        with torch.device(self.device):
            joints = np.concatenate([self._ready_joints, [FINGER_OPEN_M, FINGER_OPEN_M]])
            self.agent.reset(joints[None].repeat(count, axis=0))
            self.agent.robot.set_pose(sapien.Pose(p=[0, 0, -self.arm.base_drop_m]))
            cells = np.stack([self._start_cells(int(i), options or {}) for i in env_idx])
            where = self.layout.centres[torch.from_numpy(cells).cpu()].to(self.device, torch.float32)
            for index, (actor, body) in enumerate(zip(self.objects, self.bodies, strict=True)):
                height = torch.full((count, 1), body.height_m / 2 + 1e-4)
                actor.set_pose(Pose.create_from_pq(torch.cat([where[:, index], height], dim=1)))

    def _start_cells(self, env: int, options: dict[str, Any]) -> np.ndarray:
        cells = options.get("cells")
        if cells is None:
            cells = self._batched_episode_rng[env].permutation(self.layout.n_cells)[: len(self.bodies)]
        wrong = len(cells) != len(self.bodies) or len(set(map(int, cells))) != len(cells)
        if wrong or not all(0 <= int(cell) < self.layout.n_cells for cell in cells):
            raise InputError(
                f"cells: got {list(map(int, cells))}, want {len(self.bodies)} different cells of the layout"
            )
        return np.asarray(cells, dtype=np.int64)

    def positions(self) -> Tensor:
        """Float32[B, N, 3]: centre of each object, metres, world frame."""
        return torch.stack([actor.pose.p for actor in self.objects], dim=1)

    def leaning_deg(self) -> Tensor:
        """Float32[B, N]: angle between each object's axis and the vertical, degrees."""
        up = torch.stack([a.pose.to_transformation_matrix()[:, 2, 2] for a in self.objects], dim=1)
        return torch.rad2deg(torch.arccos(up.clamp(-1.0, 1.0)))

    def evaluate(self) -> dict[str, Tensor]:
        """Bool[B] each: the four conditions, and `success`, their conjunction."""
        at, upright = self.positions(), self.leaning_deg() < UPRIGHT_DEG
        centres = self.layout.centres.to(at)
        within = ((at[:, 1:, None, :2] - centres).abs() <= self.layout.cell_m / 2).all(-1)
        named = {
            "target_lifted": at[:, 0, 2] > self.bodies[0].height_m / 2 + self.arm.lift_m / 2,
            "target_out": at[:, 0, 0] < self.layout.front_m,
            "all_upright": upright.all(1),
            "all_in_cell": within.any(-1).all(1) & (within.sum(1) <= 1).all(-1),
        }
        return {**named, "success": torch.stack(list(named.values())).all(0)}

    def _get_obs_extra(self, info: dict[str, Any]) -> dict[str, Tensor]:
        """Object poses, where the state is observed: Float32[B, N * 7], position then quaternion (w first)."""
        if "state" not in self.obs_mode:
            return {}
        return {"object_poses": torch.cat([actor.pose.raw_pose for actor in self.objects], dim=1)}
