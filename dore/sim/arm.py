"""ManiSkill's agent for the Panda with a slim hand, and which render backend this machine has."""

from __future__ import annotations

from functools import cache
from typing import Any

import sapien
from mani_skill.agents.registration import register_agent
from mani_skill.agents.robots.panda import Panda

from dore.sim.description import arm_files


@register_agent()
class PandaSlim(Panda):
    """Franka's Panda with a 10 cm palm and plain 12 mm fingers in place of its 20 cm hand; not a product.

    The description is made from ManiSkill's own at first use (`description.arm_files`). Its gripper command is
    normalised, as the Panda's: 1 opens, -1 closes.
    """

    uid = "panda_slim"

    def __init__(self, scene: Any, *args: Any, **kwargs: Any) -> None:
        self.urdf_path = str(arm_files(visuals=scene.can_render()))
        super().__init__(scene, *args, **kwargs)


@cache
def render_backend() -> str:
    """What ManiSkill can draw with here: "gpu", "cpu" (a software Vulkan driver) or "none".

    SAPIEN can only be asked by trying: its own `can_render` answers no where lavapipe works.
    """
    sapien.render.set_log_level("off")  # what it would print is said in one line by whoever asked
    for name, device in (("gpu", "cuda"), ("cpu", "cpu")):
        try:
            sapien.render.RenderSystem(sapien.Device(device))
        except RuntimeError:
            continue
        return name
    return "none"
