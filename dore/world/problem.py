"""Scenes, and problems: a scene with the reach it is to be solved under. In code cells count from 0."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from dore.errors import InputError, integer, shown
from dore.world.layout import Layout
from dore.world.reach import Reach

if TYPE_CHECKING:
    from torch import Tensor


@dataclass(frozen=True)
class Scene:
    """Where the obstacles and the target stand. Cells count from 0; integers and arrays of NumPy and torch will do.

    obstacles: kept in ascending order.

    Raises:
        InputError: no whole number, a cell off the board, two objects on a cell, or the target among the obstacles.
    """

    layout: Layout
    obstacles: tuple[int, ...]
    target: int

    def __post_init__(self) -> None:
        loose = not isinstance(self.obstacles, Iterable) or isinstance(self.obstacles, str | bytes | Mapping)
        if loose or getattr(self.obstacles, "ndim", 1) != 1:
            raise InputError(f"scene.obstacles: got {shown(self.obstacles)}, want a list of cells")
        cells = sorted(_cell("obstacles", cell, self.layout) for cell in self.obstacles)
        object.__setattr__(self, "obstacles", tuple(cells))
        object.__setattr__(self, "target", _cell("target", self.target, self.layout))
        for cell in self.obstacles:
            if self.obstacles.count(cell) > 1:
                raise InputError(f"scene.obstacles: two objects on cell {cell_id(cell)}, want one at most")
        if self.target in self.obstacles:
            raise InputError(f"scene.target: cell {cell_id(self.target)} holds an obstacle, want the target alone")


def _cell(name: str, value: object, layout: Layout) -> int:
    cell = integer(value)
    if cell is None:
        raise InputError(f"scene.{name}: got {shown(value)}, want a whole number")
    if not 0 <= cell < layout.n_cells:
        raise InputError(f"scene.{name}: id {cell_id(cell)}, want 1 to {layout.n_cells}")
    return cell


@dataclass(frozen=True)
class Problem:
    """A scene and the reach it is to be solved under, of the same layout.

    Raises:
        InputError: their layouts differ.
    """

    scene: Scene
    reach: Reach

    def __post_init__(self) -> None:
        ours, theirs = self.scene.layout, self.reach.layout
        if not ours.coincides(theirs):
            raise InputError(f"scene.layout: got {ours}, want the reach's layout, {theirs}")


class Batch(NamedTuple):
    """Start boards Int64[B, W] and targets Int64[B]."""

    board: Tensor
    target: Tensor

    @classmethod
    def of(cls, problem: Problem) -> Batch:
        """One problem as a batch, on the device of its reach; the target may be accessible."""
        import torch

        from dore.world.board import pack

        occupied = torch.zeros(1, problem.reach.n_cells, dtype=torch.bool, device=problem.reach.device)
        occupied[0, list(problem.scene.obstacles)] = True
        return cls(pack(occupied), torch.tensor([problem.scene.target], device=problem.reach.device))


def cell_id(cell: int) -> int:
    """The paper's id of a cell: 1..G."""
    return cell + 1
