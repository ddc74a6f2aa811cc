"""What goes wrong on purpose in a closed loop; each class is a `_target_` in conf/disturbance/."""

from __future__ import annotations

from typing import Any, Protocol

import gymnasium as gym
import numpy as np
import sapien
import torch
from torch import Tensor

from dore.errors import InputError, whole
from dore.sim.frames import inside
from dore.sim.run.feedback import positions
from dore.sim.scene.agent import OPEN_HAND
from dore.sim.scene.task import DoreTabletopEnv
from dore.world.problem import Scene, cell_id


class Disturbance(Protocol):
    """Something that the arm does not know of. One instance disturbs one execution."""

    spare_objects: int
    """Objects that wait beside the table at the start."""

    def between_moves(self, world: DoreTabletopEnv, moves: int, rng: np.random.Generator) -> str | None:
        """Called once before each move, with the arm parked, `moves` moves after the start; returns what was done."""

    def grip(self, world: DoreTabletopEnv, command: float) -> float:
        """The gripper command that is carried out in place of the given one, OPEN_HAND or CLOSE_HAND."""


class Nothing:
    """Everything goes as commanded."""

    spare_objects = 0

    def between_moves(self, world: DoreTabletopEnv, moves: int, rng: np.random.Generator) -> str | None:
        """Nothing happens."""
        return None

    def grip(self, world: DoreTabletopEnv, command: float) -> float:
        """As given."""
        return command


class _Once(Nothing):
    """Something that is done once, between two moves.

    Args:
        after_moves: after how many moves of the arm.

    Raises:
        InputError: below 0.
    """

    def __init__(self, after_moves: int) -> None:
        self.after_moves = whole("disturbance.after_moves", after_moves, 0)

    def between_moves(self, world: DoreTabletopEnv, moves: int, rng: np.random.Generator) -> str | None:
        """After so many moves."""
        return self._disturb(world, rng) if moves == self.after_moves else None

    def _disturb(self, world: DoreTabletopEnv, rng: np.random.Generator) -> str | None:
        raise NotImplementedError


class ObjectMoved(_Once):
    """An obstacle is put on another, empty cell."""

    def _disturb(self, world: DoreTabletopEnv, rng: np.random.Generator) -> str | None:
        obstacles = {body: cell for body, cell in _cells(world).items() if body != 0}
        if not obstacles:
            return None
        body = int(rng.choice(list(obstacles)))
        to = _put(world, body, rng)
        return f"the object on cell {cell_id(obstacles[body])} is moved to cell {cell_id(to)}"


class IntruderObject(_Once):
    """A further obstacle is put on an empty cell."""

    spare_objects = 1

    def _disturb(self, world: DoreTabletopEnv, rng: np.random.Generator) -> str:
        return f"another object is put on cell {cell_id(_put(world, len(world.bodies) - 1, rng))}"


class SlippingGrasp(Nothing):
    """The fingers lose an object as they lift it, and it stays behind.

    Args:
        at_grasp: which grasp fails, counted from 1.

    Raises:
        InputError: below 1.
    """

    def __init__(self, at_grasp: int) -> None:
        self.grasps_left = whole("disturbance.at_grasp", at_grasp, 1)
        self._lifted = self._slipping = False

    def grip(self, world: DoreTabletopEnv, command: float) -> float:
        """Open from the moment the object leaves the table until the hand has left the grid."""
        heights = np.array([body.height_m for body in world.bodies]) / 2
        lifted = command != OPEN_HAND and bool((positions(world)[:, 2] - heights > world.arm.lift_m / 3).any())
        if lifted and not self._lifted:
            self.grasps_left -= 1
            self._slipping = self.grasps_left == 0
        self._lifted = lifted or (self._lifted and command != OPEN_HAND)
        outside = float(world.agent.tcp_pos[0, 0]) < world.layout.front_m - world.arm.staging_m / 2
        self._slipping &= not outside
        return OPEN_HAND if self._slipping else command


class Disturbed(gym.ActionWrapper[Any, Any, Any]):
    """An environment whose gripper does what the disturbance says."""

    def __init__(self, env: Any, disturbance: Disturbance) -> None:
        super().__init__(env)
        self._disturbance = disturbance

    def action(self, action: Tensor) -> Tensor:
        """The last entry is the gripper's."""
        world: Any = self.env.unwrapped
        changed = self._disturbance.grip(world, float(action[-1]))
        return torch.cat([action[:-1], action.new_tensor([changed])])


def check_room(disturbance: Disturbance, scene: Scene) -> None:
    """Refuse a scene without room for what a disturbance puts in.

    Raises:
        InputError: says how many cells are left.
    """
    room, spare = scene.layout.n_cells - 1 - len(scene.obstacles), disturbance.spare_objects
    if spare > room:
        raise InputError(f"disturbance: puts in {spare} more, and the scene has {room} cells left")


def _cells(world: DoreTabletopEnv) -> dict[int, int]:
    """The cell of each object that stands in one."""
    layout, at = world.layout, positions(world)
    within = [inside(layout.centres.numpy(), layout.cell_m, xy).nonzero()[0] for xy in at[:, :2]]
    return {body: int(cells[0]) for body, cells in enumerate(within) if len(cells)}


def _put(world: DoreTabletopEnv, body: int, rng: np.random.Generator) -> int:
    """Put an object, upright, on an empty cell; returns the cell."""
    taken = set(_cells(world).values())
    to = int(rng.choice([cell for cell in range(world.layout.n_cells) if cell not in taken]))
    height = world.bodies[body].height_m / 2 + 1e-4
    world.objects[body].set_pose(sapien.Pose(p=[*world.layout.cells[to], height]))
    world.objects[body].set_linear_velocity(torch.zeros(1, 3))
    world.objects[body].set_angular_velocity(torch.zeros(1, 3))
    return to
