"""ManiSkill's agent for any arm of conf/arm, and which render backend this machine has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

import numpy as np
import sapien
import torch
from mani_skill.agents.base_agent import BaseAgent
from mani_skill.agents.controllers import (
    PDEEPoseControllerConfig,
    PDJointPosControllerConfig,
    PDJointPosMimicController,
    PDJointPosMimicControllerConfig,
    deepcopy_dict,
)
from mani_skill.utils.structs.actor import Actor
from mani_skill.utils.structs.link import Link
from torch import Tensor

from dore.sim.config import ArmConfig
from dore.sim.frames import Array
from dore.sim.urdf import arm_files

_GRASP_FORCE_N = 0.5
"""A weaker force from either side is not a grasp."""
_FINGER_FRICTION = 2.0
OPEN_HAND, CLOSE_HAND = 1.0, -1.0
"""The gripper's commands."""
NO_DRIVER = "no Vulkan driver here; scripts/install_lavapipe.sh installs one (Debian 12, as root)"
"""What every message says where nothing can render."""
_DRIVE = ("stiffness", "damping", "force_limit")


class _Grip(PDJointPosMimicController):
    """The fingers under one command; 1 opens them, whichever way they turn to open."""

    config: _GripConfig

    def set_action(self, action: Tensor) -> None:
        """Command Float32[B, 1]."""
        super().set_action(-action if self.config.opens_downwards else action)


@dataclass
class _GripConfig(PDJointPosMimicControllerConfig):
    controller_cls = _Grip
    opens_downwards: bool = False


class ArmAgent(BaseAgent):
    """An arm with its fingers, B copies of it. Subclasses, made by `agent_of`, say which arm.

    The gripper's command is one number, OPEN_HAND or CLOSE_HAND.
    """

    arm: ClassVar[ArmConfig]

    def __init__(self, scene: Any, *args: Any, **kwargs: Any) -> None:
        self.urdf_path = str(arm_files(visuals=scene.can_render(), arm=self.arm))
        # Without an SRDF the hulls of neighbouring links would push each other. The rehearsal checks the arm itself.
        self.disable_self_collisions = self.arm.model.describe(self.arm.urdf).srdf is None
        super().__init__(scene, *args, **kwargs)

    @property
    def _controller_configs(self) -> dict[str, Any]:
        model = self.arm.model
        arm: dict[str, Any] = dict(zip(_DRIVE, model.arm_drive, strict=True))
        grip: dict[str, Any] = dict(zip(_DRIVE, model.finger_drive, strict=True))
        leader, (opened, closed) = next(iter(model.fingers.items()))
        mimic = {}
        for name, (other_opened, other_closed) in model.fingers.items():
            if name != leader:
                ratio = (other_opened - other_closed) / (opened - closed)
                mimic[name] = {"joint": leader, "multiplier": ratio, "offset": other_closed - ratio * closed}
        joints = list(model.joints)
        low, high = sorted((opened, closed))
        hand = _GripConfig(
            list(model.fingers), lower=low, upper=high, mimic=mimic, opens_downwards=opened < closed, **grip
        )
        ways = {
            "pd_joint_pos": PDJointPosControllerConfig(joints, None, None, normalize_action=False, **arm),
            "pd_joint_delta_pos": PDJointPosControllerConfig(joints, -0.1, 0.1, use_delta=True, **arm),
            "pd_ee_delta_pose": PDEEPoseControllerConfig(
                joints, pos_lower=-0.1, pos_upper=0.1, rot_lower=-0.1, rot_upper=0.1, ee_link=model.tool_link,
                urdf_path=self.urdf_path, **arm,
            ),
        }  # fmt: skip
        configs: dict[str, Any] = deepcopy_dict({name: {"arm": way, "gripper": hand} for name, way in ways.items()})
        return configs

    def _after_loading_articulation(self) -> None:
        links = {link.name: link for link in self.robot.get_links()}
        self.tcp: Link = links[self.arm.model.tool_link]
        self._jaws = [[links[name] for name in side] for side in self.arm.model.jaws]
        names = [joint.name for joint in self.robot.active_joints]
        self._arm_at = [names.index(name) for name in self.arm.model.joints]
        self._finger_at = [names.index(name) for name in self.arm.model.fingers]

    @property
    def tcp_pos(self) -> Tensor:
        """Float32[B, 3]: the grasp point, metres."""
        return self.tcp.pose.p

    def arm_joints(self) -> Tensor:
        """Float32[B, J]: the arm's joints, radians, without the fingers."""
        return self.robot.get_qpos()[:, self._arm_at]

    def opening(self) -> Tensor:
        """Float32[B]: how far the hand is open, 1 wide open, 0 closed on nothing."""
        ends = torch.tensor(list(self.arm.model.fingers.values()), device=self.device)
        limits = self.robot.get_qlimits()[:, self._finger_at]
        opened, closed = (ends[:, i].clamp(limits[..., 0], limits[..., 1]) for i in (0, 1))
        return ((self.robot.get_qpos()[:, self._finger_at] - closed) / (opened - closed)).mean(1)

    def open_handed(self, joints: Array) -> Array:
        """Float64[D]: all of the robot's joints, the arm's at Float64[J] and the hand open."""
        qpos = np.zeros(len(self.robot.active_joints))
        qpos[self._arm_at] = joints
        qpos[self._finger_at] = [opened for opened, _ in self.arm.model.fingers.values()]
        return qpos

    def is_grasping(self, item: Actor) -> Tensor:
        """Bool[B]: both sides of the hand press on an object, and against each other."""
        one, other = (self._press(side, item) for side in self._jaws)
        pressed = (one.norm(dim=1) >= _GRASP_FORCE_N) & (other.norm(dim=1) >= _GRASP_FORCE_N)
        return pressed & ((one * other).sum(1) < 0)

    def _press(self, links: Sequence[Link], item: Actor) -> Tensor:
        """Float32[B, 3]: the force of some links on an object, newtons."""
        return torch.stack([self.scene.get_pairwise_contact_forces(link, item) for link in links]).sum(0)


def agent_of(arm: ArmConfig) -> type[ArmAgent]:
    """The agent's class for an arm; ManiSkill takes it where it takes a uid."""
    pad = {"material": "grip", "patch_radius": 0.1, "min_patch_radius": 0.1}
    links = {name: pad for side in arm.model.jaws for name in side}
    grip = {"static_friction": _FINGER_FRICTION, "dynamic_friction": _FINGER_FRICTION, "restitution": 0.0}
    fields = {"uid": arm.name, "arm": arm, "urdf_config": {"_materials": {"grip": grip}, "link": links}}
    return type(f"{arm.name}_agent", (ArmAgent,), fields)


@cache
def render_backend() -> str:
    """What ManiSkill can draw with here: "gpu", "cpu" (a software Vulkan driver) or "none".

    Found out by trying: SAPIEN's own `can_render` says no where lavapipe works.
    """
    sapien.render.set_log_level("off")  # the caller says it in one line
    for name, device in (("gpu", "cuda"), ("cpu", "cpu")):
        try:
            sapien.render.RenderSystem(sapien.Device(device))
        except RuntimeError:
            continue
        return name
    return "none"
