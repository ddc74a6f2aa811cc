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
from dore.files import conf_dir
from dore.sim.camera_config import CameraConfig
from dore.sim.config import ArmConfig, Body, ViewConfig, preset
from dore.sim.kinematics import ArmKinematics, Unreachable
from dore.sim.scene.agent import ArmAgent, agent_of
from dore.sim.scene.scene_builder import build_objects, build_surroundings, remove_objects, waiting_xy
from dore.sim.scene.start import check_apart, for_each, start_cells
from dore.sim.urdf import arm_files
from dore.world.layout import Layout

UPRIGHT_DEG = 10.0
"""An object leaning more than this no longer counts as upright."""
CAMERA = "camera"
"""The name of the task's RGB-D camera among its sensors."""
# SAPIEN's cameras look along x, with y to the left and z up; a picture's x is right, y down and z ahead.
_CAMERA_AXES = np.array([[0, -1.0, 0, 0], [0, 0, -1.0, 0], [1.0, 0, 0, 0], [0, 0, 0, 1.0]])


@register_env("DoreTabletop-v1", max_episode_steps=100_000)
class DoreTabletopEnv(BaseEnv):
    """Objects stand in the cells of a table before the arm; one of them is the target.

    **Task:** take the target out of the grid and hold it up, with every other object upright in a cell.

    **Randomisation:** which cells the objects stand in, unless `reset(options={"cells": [...]})` names one cell
    per object, the target's first; cells count from 0. Objects beyond those named wait beside the table, and are
    ignored until they are put on it. The options `offsets_m`, [x, y] for each cell named, and `yaws_rad` move
    objects out of the middle of their cells and turn them; without them they stand straight. `bodies` exchanges the
    objects, the target's first, which takes less time than another environment; CPU simulation only.

    **Observations:** `state` and `state_dict` anywhere; with a Vulkan driver `rgb+depth+segmentation` too, by the
    sensor `camera`. `dore.sim.vision.camera.RgbdCamera` reads it in any mode, with a real sensor's noise.

    **Success:** `target_lifted`, `target_out`, `all_upright` and `all_in_cell`, all of them.

    World frame: REP-103 at the robot base's axis; z = 0 is the table top, the base stands below it.

    Args:
        layout: the cells, regular or not; None: 3 x 6 of 12 cm, front edge at 0.50 m.
        bodies: the objects, the target first; None: seven mixed ones of fixed sizes.
        robot_uids: the arm, by its name in conf/arm, unless `arm` is given.
        arm: which arm it is, and how it stands.
        kinematics: the arm's, where the caller has built it; it brings the arm, so give it in place of `arm`.
        view: the viewpoint of `render()`.
        camera: the RGB-D camera; `RgbdCamera` takes its pictures.
        density_kg_m3: of the objects.
        judge_steps: every step's info has what `evaluate` says, which takes a quarter of the time.

    Raises:
        InputError: more objects than cells, a layout out of the arm's reach, an unknown arm, or one that needs the
            path of its description. `reset`: options that are not one for each object, or not numbers; a cell named
            twice, or not of the layout; objects that overlap.
    """

    SUPPORTED_ROBOTS = None  # any arm that conf/arm describes
    SUPPORTED_REWARD_MODES = ["sparse", "none"]  # noqa: RUF012
    agent: ArmAgent

    def __init__(
        self,
        *args: Any,
        robot_uids: str = "panda_slim",
        layout: Layout | None = None,
        bodies: Sequence[Body] | None = None,
        arm: ArmConfig | None = None,
        kinematics: ArmKinematics | None = None,
        view: ViewConfig | None = None,
        camera: CameraConfig | None = None,
        density_kg_m3: float = 400.0,
        judge_steps: bool = True,
        **kwargs: Any,
    ) -> None:
        self.layout = layout or Layout.grid(3, 6, 0.12, 0.50)
        self.bodies = tuple(bodies or preset("objects/mixed").draw(7, np.random.default_rng(0)))
        self.arm = kinematics.arm if kinematics else arm or _arm_called(robot_uids)
        self.view, self.camera = view or preset("view/corner"), camera or preset("camera/kinect")
        self.density_kg_m3, self.judge_steps = density_kg_m3, judge_steps
        self.objects: list[Any] = []
        kinematics = kinematics or ArmKinematics(arm_files(visuals=False, arm=self.arm), self.arm)
        try:
            self._ready_joints = kinematics.ready(self.layout.front_m - self.arm.staging_m).joints
        except Unreachable as error:
            raise InputError(f"layout.front_m: {self.layout.front_m:g} m, out of the arm's reach: {error}") from None
        super().__init__(*args, robot_uids=agent_of(self.arm), **kwargs)

    @property
    def _default_sim_config(self) -> SimConfig:
        return SimConfig(sim_freq=100, control_freq=20)

    @property
    def _default_sensor_configs(self) -> list[SensorConfig]:
        camera, pose = self.camera, sapien.Pose(self.camera.pose(self.layout) @ _CAMERA_AXES)
        fov = math.radians(camera.field_of_view_deg)
        return [SensorConfig(CAMERA, pose, camera.width_px, camera.height_px, fov=fov, near=0.01, far=10)]

    @property
    def _default_human_render_camera_configs(self) -> SensorConfig:
        view = self.view
        pose = sapien_utils.look_at(list(view.position_m), list(view.look_at_m))
        fov = math.radians(view.field_of_view_deg)
        return SensorConfig("view", pose, view.width_px, view.height_px, fov=fov, near=0.01, far=20)

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
        self._build_objects(self.bodies)

    def _build_objects(self, bodies: tuple[Body, ...]) -> None:
        if len(bodies) > self.layout.n_cells:
            raise InputError(f"bodies: {len(bodies)} objects, want at most {self.layout.n_cells}, one a cell")
        self.bodies = bodies
        self.objects = build_objects(self.scene, self.bodies, self.density_kg_m3)
        self._shelf = torch.tensor([waiting_xy(index) for index in range(len(self.bodies))])

    def _initialize_episode(self, env_idx: Tensor, options: dict[str, Any]) -> None:
        options = options or {}
        bodies = tuple(options.get("bodies") or self.bodies)
        if bodies != self.bodies:
            remove_objects(self.scene, self.objects)
            self._build_objects(bodies)
        with torch.device(self.device):
            joints = self.agent.open_handed(self._ready_joints)
            self.agent.reset(joints[None].repeat(len(env_idx), axis=0))
            self.agent.robot.set_pose(sapien.Pose(p=[0, 0, -self.arm.base_drop_m]))
            cells = np.stack([self._start_cells(int(env), options.get("cells")) for env in env_idx])
            count = cells.shape[1]
            where = self.layout.centres.numpy()[cells] + for_each("offsets_m", count, 2, options)
            check_apart(where, self.bodies)
            half_turn = np.zeros(len(self.bodies))
            half_turn[:count] = for_each("yaws_rad", count, 1, options)[:, 0] / 2
            for index, (actor, body) in enumerate(zip(self.objects, self.bodies, strict=True)):
                xy = where[:, index] if index < count else np.tile(waiting_xy(index), (len(env_idx), 1))
                at = np.column_stack([xy, np.full(len(env_idx), body.height_m / 2 + 1e-4)])
                turned = [math.cos(half_turn[index]), 0.0, 0.0, math.sin(half_turn[index])]
                actor.set_pose(Pose.create_from_pq(torch.from_numpy(at).float(), torch.tensor(turned)))

    def _start_cells(self, env: int, cells: Sequence[int] | None) -> np.ndarray:
        if cells is None:
            cells = self._batched_episode_rng[env].permutation(self.layout.n_cells)[: len(self.bodies)]
        return start_cells(cells, len(self.bodies), self.layout.n_cells)

    def poses(self) -> Tensor:
        """Float32[B, N, 7]: centre of each object, metres, and its quaternion, w first; world frame."""
        return torch.stack([actor.pose.raw_pose for actor in self.objects], dim=1)

    def positions(self) -> Tensor:
        """Float32[B, N, 3]: centre of each object, metres, world frame."""
        return self.poses()[..., :3]

    def leaning_deg(self) -> Tensor:
        """Float32[B, N]: angle between each object's axis and the vertical, degrees."""
        return _leaning_deg(self.poses())

    def waiting(self) -> Tensor:
        """Bool[B, N]: which objects wait beside the table."""
        return self._waiting(self.positions())

    def _waiting(self, at: Tensor) -> Tensor:
        return torch.linalg.norm(at[..., :2] - self._shelf.to(at), dim=-1) < 0.05

    def evaluate(self) -> dict[str, Tensor]:
        """Bool[B] each: the four conditions, and `success`, their conjunction."""
        poses = self.poses()  # once, since ManiSkill asks after every step
        at, upright = poses[..., :3], _leaning_deg(poses) < UPRIGHT_DEG
        centres, beside = self.layout.centres.to(at), self._waiting(at)
        within = ((at[:, 1:, None, :2] - centres).abs() <= self.layout.cell_m / 2).all(-1)
        named = {
            "target_lifted": at[:, 0, 2] > self.bodies[0].height_m / 2 + self.arm.lift_m / 2,
            "target_out": at[:, 0, 0] < self.layout.front_m,
            "all_upright": (upright | beside).all(1),
            "all_in_cell": (within.any(-1) | beside[:, 1:]).all(1) & (within.sum(1) <= 1).all(-1),
        }
        return {**named, "success": torch.stack(list(named.values())).all(0)}

    def get_info(self) -> dict[str, Any]:
        """What ManiSkill returns with each step."""
        return super().get_info() if self.judge_steps else {"elapsed_steps": self.elapsed_steps}

    def _get_obs_extra(self, info: dict[str, Any]) -> dict[str, Tensor]:
        """Object poses, where the state is observed: Float32[B, N * 7], position then quaternion (w first)."""
        if "state" not in self.obs_mode:
            return {}
        return {"object_poses": self.poses().flatten(1)}


def _leaning_deg(poses: Tensor) -> Tensor:
    """Float32[B, N] of Float32[B, N, 7]."""
    up = 1.0 - 2.0 * poses[..., 4:6].square().sum(-1)
    return torch.rad2deg(torch.arccos(up.clamp(-1.0, 1.0)))


def _arm_called(name: str) -> ArmConfig:
    """An arm of conf/arm.

    Raises:
        InputError: no arm has that name, or it needs the path of its description.
    """
    known = sorted(path.stem for path in (conf_dir() / "arm").glob("*.yaml"))
    if name not in known:
        raise InputError(f"robot_uids: got {name!r}, want one of {', '.join(known)}")
    arm: ArmConfig = preset(f"arm/{name}")
    return arm
