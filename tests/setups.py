"""The slim-handed Panda with mixed objects on its 3 x 6 cells, and plans for it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from dore.sim.config import preset
from dore.sim.run.setup import Setup
from dore.world.layout import Layout
from dore.world.plan import Move, Plan, PlanFile, Status
from dore.world.problem import Problem, Scene
from dore.world.reach import Reach

LAYOUT = Layout.grid(3, 6, 0.12, 0.50)
REACH = Reach(LAYOUT, 0.10, 30.0, 61, staging_m=0.07, lateral_limit_m=0.42, max_yaw_deg=60.0)
"""The arm's, with a sector at 0 degrees."""
FIG7 = Scene(LAYOUT, obstacles=(15, 2, 8, 6, 12, 0), target=14)
ARM = preset("arm/panda_slim")
OBJECTS = preset("objects/mixed")


def setup(**changes: Any) -> Setup:
    """Without pictures."""
    return replace(Setup(ARM, OBJECTS, preset("view/corner"), preset("camera/kinect"), seed=0, film=False), **changes)


def plan_of(*moves: Move, scene: Scene = FIG7, target_direction_deg: float = 0.0) -> PlanFile:
    reach = Reach(scene.layout, **REACH.to_dict())
    return PlanFile(Problem(scene, reach), Plan(Status.SOLVED, moves, target_direction_deg, "test", 0.0))
