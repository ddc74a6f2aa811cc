"""Boards as a camera sees them, and what becomes of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from dore.draw.boards import Panel
from dore.sim.config import Body
from dore.sim.motion.outcome import Outcome
from dore.sim.motion.rehearsal import MoveTask, Refused
from dore.sim.vision.scene_estimate import Sighting, cell_of, scene_of
from dore.world.layout import Layout
from dore.world.plan import Move
from dore.world.problem import Problem, Scene, cell_id
from dore.world.reach import Reach


@dataclass(frozen=True)
class Seen:
    """What the camera saw: the scene, and each of its objects, the target first."""

    scene: Scene
    objects: tuple[Sighting, ...]

    @classmethod
    def of(cls, sightings: Sequence[Sighting], layout: Layout) -> Seen:
        """The scene of some sightings.

        Raises:
            NotUnderstood: they are no scene.
        """
        scene = scene_of(sightings, layout)
        on = {cell_of(one, layout): one for one in sightings}
        return cls(scene, tuple(on[cell] for cell in (scene.target, *scene.obstacles)))

    @property
    def words(self) -> str:
        """The board in a line."""
        listed = ", ".join(str(cell_id(cell)) for cell in sorted(self.scene.obstacles))
        return f"target on {cell_id(self.scene.target)}, obstacles on {listed or 'no cell'}"

    @property
    def bodies(self) -> tuple[Body, ...]:
        """Every object as wide and as tall as it is seen."""
        return tuple(Body(one.shape, one.half_width_m, one.height_m) for one in self.objects)


def confirm(sightings: Sequence[Sighting], before: Scene) -> None:
    """Whether the target, and nothing but the target, has left a board.

    Raises:
        Refused: UNCONFIRMED.
    """
    # What hangs in the hand, before the grid, is not on the board.
    on_board = [one for one in sightings if one.xy[0] > before.layout.front_m]
    if any(one.is_target for one in on_board):
        raise Refused(Outcome.UNCONFIRMED, "the camera", "the target still stands on the board")
    cells = [cell_of(one, before.layout) if one.upright else None for one in on_board]
    if len(cells) != len(before.obstacles) or set(cells) != set(before.obstacles):
        raise Refused(Outcome.UNCONFIRMED, "the camera", "the obstacles do not stand where they stood")


def same_board(one: Scene, other: Scene | None) -> bool:
    """Whether the same cells are taken; the obstacles' order means nothing."""
    return other is not None and one.target == other.target and sorted(one.obstacles) == sorted(other.obstacles)


def after_move(scene: Scene, move: Move) -> Scene:
    """The board that a move leads to."""
    obstacles = (move.place if cell == move.pick else cell for cell in scene.obstacles)
    return replace(scene, obstacles=tuple(obstacles))


def panel_of(scene: Scene, reach: Reach, task: MoveTask, number: int) -> Panel:
    """The board with a move's lanes, for the film."""
    if task.place_cell is None:
        return Panel(Problem(scene, reach), None, task.pick_direction_deg, number)
    move = Move(task.pick_cell, task.place_cell, task.pick_direction_deg, task.place_direction_deg)
    return Panel(Problem(scene, reach), move, number=number)
