"""A plan as a picture, with one board per move; or one board as pixels. Matplotlib's objects, no global state."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.typing import ColorType
from numpy.typing import NDArray

from dore.draw.board_art import (
    CELL_INCH,
    LEGEND,
    OBSTACLE_COLOUR,
    PICK_CORRIDOR_COLOUR,
    PLACE_CORRIDOR_COLOUR,
    RADIUS,
    TARGET_COLOUR,
    draw_arrow,
    draw_cells,
    draw_corridor,
    draw_legend,
    extent,
    on_paper,
)
from dore.draw.style import INK, save_figure
from dore.world.plan import Move, Plan, replay
from dore.world.problem import Problem, Scene, cell_id

MAX_WIDTH_INCH = 12.6
GAP_INCH, TITLE_INCH, HEAD_INCH, FOOT_INCH = 0.25, 0.32, 0.42, 0.38
"""Between panels; above each for its title; above all; below all for the legend."""
PANEL_LEGEND_INCH = (2.5, 0.42)
"""Width and height of the legend of a panel that stands alone."""


@dataclass(frozen=True)
class Panel:
    """A board and what happens on it next: a move, the target's retrieval, or nothing.

    problem: where the objects stand before it, and the reach. number: the move's, as written on its obstacle.
    """

    problem: Problem
    move: Move | None = None
    target_direction_deg: float | None = None
    number: int = 1

    @property
    def scene(self) -> Scene:
        """Where the objects stand."""
        return self.problem.scene

    @property
    def words(self) -> str:
        """What happens: "3 to 12", "retrieve 15" or "no way found to 15"."""
        if self.move is not None:
            return f"{cell_id(self.move.pick)} to {cell_id(self.move.place)}"
        found = self.target_direction_deg is not None
        return f"{'retrieve' if found else 'no way found to'} {cell_id(self.scene.target)}"


def panels_of(problem: Problem, plan: Plan) -> tuple[Panel, ...]:
    """One panel per move, then one for the retrieval; nothing happens on it where no solution was found.

    Raises:
        PlanError: the plan does not replay.
    """
    boards = [
        Problem(replace(problem.scene, obstacles=tuple(sorted(board))), problem.reach)
        for board in replay(problem, plan)
    ]
    moves = [Panel(boards[i], move, number=i + 1) for i, move in enumerate(plan.moves)]
    return (*moves, Panel(boards[-1], None, plan.target_direction_deg, len(moves) + 1))


def draw_plan(problem: Problem, plan: Plan, path: str | os.PathLike[str]) -> None:
    """Write a PNG with one panel per move and one for the retrieval, in reading order.

    The robot stands below each panel and looks up: row 0 is at the bottom, its left is on the left. An approach
    corridor is as wide as twice the reach's clearance; obstacles' centres stay out of it.

    Raises:
        PlanError: the plan does not replay.
    """
    panels = panels_of(problem, plan)
    left, right, bottom, top = extent(problem.scene)
    inch = CELL_INCH / problem.scene.layout.cell_m
    width, height = (right - left) * inch, (top - bottom) * inch
    rows = math.ceil(len(panels) / max(1, int((MAX_WIDTH_INCH - GAP_INCH) / (width + GAP_INCH))))
    columns = math.ceil(len(panels) / rows)
    across, down = width + GAP_INCH, height + TITLE_INCH
    size = (max(columns * across + GAP_INCH, 4.9), rows * down + HEAD_INCH + FOOT_INCH)
    figure = Figure(size, facecolor="white")
    indent = (size[0] - columns * across + GAP_INCH) / 2
    for index, panel in enumerate(panels):
        row, column = divmod(index, columns)
        corner = (indent + column * across, size[1] - HEAD_INCH - (row + 1) * down)
        box = (corner[0] / size[0], corner[1] / size[1], width / size[0], height / size[1])
        axes = figure.add_axes(box)
        title = panel.words if panel.words.startswith("no way") else f"{panel.number}.  {panel.words}"
        axes.set_title(title, fontsize=9, color=INK, pad=3)
        draw_panel(axes, panel)
    count = f"{len(plan.moves)} rearrangement" + "s" * (len(plan.moves) != 1)
    title = f"{plan.planner}: {plan.status.replace('_', ' ')}, {count}"
    figure.text(
        0.5, 1 - HEAD_INCH / 2 / size[1], title, ha="center", va="center", fontsize=11, color=INK, weight="bold"
    )
    draw_legend(figure, tuple(LEGEND), columns=4)
    save_figure(figure, path)


def panel_pixels(
    panel: Panel, width_px: int, max_height_px: int, colours: Mapping[int, ColorType]
) -> NDArray[np.uint8]:
    """UInt8[H, width_px, 3]: one board with its legend, as tall as it needs to be and `max_height_px` at most.

    colours: of the objects on these cells, in place of the usual ones.
    """
    left, right, bottom, top = extent(panel.scene)
    inch = CELL_INCH / panel.scene.layout.cell_m
    across, down = (right - left) * inch, (top - bottom) * inch
    # The legend grows with the board: wide boards are drawn small, and it must stay readable.
    scale = max(1.0, across / PANEL_LEGEND_INCH[0])
    width, height = PANEL_LEGEND_INCH[0] * scale, down + PANEL_LEGEND_INCH[1] * scale
    dpi = min(width_px / width, max_height_px / height)
    size = (width_px / dpi, int(height * dpi) / dpi)
    figure = Figure(size, dpi=dpi, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    box = (0.5 - across / 2 / size[0], 1 - down / size[1], across / size[0], down / size[1])
    draw_panel(figure.add_axes(box), panel, colours)
    draw_legend(figure, tuple(LEGEND)[1:], columns=2, scale=scale)
    canvas.draw()
    return np.array(canvas.buffer_rgba())[..., :3]


def draw_panel(axes: Axes, panel: Panel, colours: Mapping[int, ColorType] = MappingProxyType({})) -> None:
    """One board and what happens on it. colours: of the objects on these cells, in place of the usual ones."""
    problem, scene, move = panel.problem, panel.scene, panel.move
    draw_cells(axes, scene)
    if move is not None:
        draw_corridor(axes, problem, move.place, move.place_direction_deg, PLACE_CORRIDOR_COLOUR)
        draw_corridor(axes, problem, move.pick, move.pick_direction_deg, PICK_CORRIDOR_COLOUR)
    if panel.target_direction_deg is not None:
        draw_corridor(axes, problem, scene.target, panel.target_direction_deg, TARGET_COLOUR)
    size = RADIUS * scene.layout.cell_m
    usual: dict[int, ColorType] = {**dict.fromkeys(scene.obstacles, OBSTACLE_COLOUR), scene.target: TARGET_COLOUR}
    for cell, colour in usual.items():
        colour = colours.get(cell, colour)
        axes.add_patch(Circle(on_paper(scene, cell), size, facecolor=colour, edgecolor="white", lw=0.8, zorder=4))
    if move is not None:
        edge = colours.get(move.pick, OBSTACLE_COLOUR)
        place = Circle(on_paper(scene, move.place), size, facecolor="white", edgecolor=edge, lw=1.2, zorder=4)
        place.set_linestyle((0, (2.5, 1.5)))
        axes.add_patch(place)
        draw_arrow(axes, scene, move.pick, move.place, panel.number)
