"""A plan as a picture: a strip of boards, one a move; or one board as pixels. Matplotlib's objects, no global state."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrowPatch, Patch, Polygon, Rectangle
from matplotlib.typing import ColorType
from numpy.typing import NDArray

from dore.errors import atomic_write
from dore.plan import Move, Plan, Scene, cell_id, replay
from dore.reach import Reach

OBSTACLE, TARGET, INK, FAINT = "#c8553d", "#2e8b57", "#2b2d33", "#8b8f98"
PICK_LANE, PLACE_LANE = "#4c78a8", "#e0a030"
CELL_INCH = 0.46
"""Edge of a cell on paper; everything else follows from it, so text never crowds the cells."""
MAX_WIDTH_INCH = 12.6
GAP_INCH, TITLE_INCH, HEAD_INCH, FOOT_INCH = 0.25, 0.32, 0.42, 0.38
"""Between panels; above each for its title; above all; below all for the legend."""
DPI = 200
RADIUS = 0.3
"""Radius of an object as drawn, in cells; the true one is the reach's affair."""
PANEL_LEGEND_INCH = (2.5, 0.42)
"""Width and height of the legend of a panel that stands alone."""
LEGEND = {
    "obstacle": (OBSTACLE, 1.0),
    "target and its lane": (TARGET, 1.0),
    "lane of the pick": (PICK_LANE, 0.5),
    "lane of the place": (PLACE_LANE, 0.5),
}
"""What each colour means, with its opacity."""


@dataclass(frozen=True)
class Panel:
    """A board and what happens on it next: a move, the target's retrieval, or nothing.

    scene: where the objects stand before it. number: the move's, as written on its obstacle.
    """

    scene: Scene
    reach: Reach
    move: Move | None = None
    target_direction_deg: float | None = None
    number: int = 1

    @property
    def words(self) -> str:
        """What happens: "3 to 12", "retrieve 15" or "no way found to 15"."""
        if self.move is not None:
            return f"{cell_id(self.move.pick)} to {cell_id(self.move.place)}"
        found = self.target_direction_deg is not None
        return f"{'retrieve' if found else 'no way found to'} {cell_id(self.scene.target)}"


def panels_of(scene: Scene, reach: Reach, plan: Plan) -> tuple[Panel, ...]:
    """One panel a move, then one for the retrieval; where no way to the target was found, nothing happens on it.

    Raises:
        PlanError: the plan does not replay.
    """
    boards = [Scene(scene.layout, tuple(sorted(board)), scene.target) for board in replay(scene, reach, plan)]
    moves = [Panel(boards[i], reach, move, number=i + 1) for i, move in enumerate(plan.moves)]
    return (*moves, Panel(boards[-1], reach, None, plan.target_direction_deg, len(moves) + 1))


def draw_plan(scene: Scene, reach: Reach, plan: Plan, path: str | os.PathLike[str]) -> None:
    """Write a PNG with one panel a move and one for the retrieval, in reading order.

    The robot stands below each panel and looks up: row 0 is at the bottom, its left is on the left. A lane is as
    wide as twice the reach's clearance; obstacles' centres stay out of it.

    Raises:
        PlanError: the plan does not replay.
    """
    panels = panels_of(scene, reach, plan)
    left, right, bottom, top = _extent(scene)
    inch = CELL_INCH / scene.layout.cell_m
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
        axes = figure.add_axes(box, xlim=(left, right), ylim=(bottom, top))
        title = panel.words if panel.words.startswith("no way") else f"{panel.number}.  {panel.words}"
        axes.set_title(title, fontsize=9, color=INK, pad=3)
        _draw_panel(axes, panel, {})
    count = f"{len(plan.moves)} rearrangement" + "s" * (len(plan.moves) != 1)
    title = f"{plan.planner}: {plan.status.replace('_', ' ')}, {count}"
    figure.text(
        0.5, 1 - HEAD_INCH / 2 / size[1], title, ha="center", va="center", fontsize=11, color=INK, weight="bold"
    )
    _draw_legend(figure, tuple(LEGEND), columns=4)
    with atomic_write(path, "wb") as file:
        figure.savefig(file, format="png", dpi=DPI)


def panel_pixels(
    panel: Panel, width_px: int, max_height_px: int, colours: Mapping[int, ColorType]
) -> NDArray[np.uint8]:
    """UInt8[H, width_px, 3]: one board with its legend, as tall as it needs to be and `max_height_px` at most.

    colours: of the objects on these cells, in place of the usual ones.
    """
    left, right, bottom, top = _extent(panel.scene)
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
    _draw_panel(figure.add_axes(box, xlim=(left, right), ylim=(bottom, top)), panel, colours)
    _draw_legend(figure, tuple(LEGEND)[1:], columns=2, scale=scale)
    canvas.draw()
    return np.array(canvas.buffer_rgba())[..., :3]


def _extent(scene: Scene) -> tuple[float, float, float, float]:
    """Left, right, bottom and top of a panel, metres: the cells and a strip for the robot's side."""
    half = scene.layout.cell_m / 2
    xs, ys = zip(*scene.layout.cells, strict=True)
    edge = 0.12 * half
    return -max(ys) - half - edge, -min(ys) + half + edge, min(xs) - 1.7 * half, max(xs) + half + edge


def _on_paper(scene: Scene, cell: int) -> tuple[float, float]:
    """Where a cell's centre is drawn: right is the robot's right, up is away from it."""
    x, y = scene.layout.cells[cell]
    return -y, x


def _draw_panel(axes: Axes, panel: Panel, colours: Mapping[int, ColorType]) -> None:
    """One board and what happens on it. colours: of the objects on these cells, in place of the usual ones."""
    scene, reach, move = panel.scene, panel.reach, panel.move
    axes.axis("off")
    _draw_cells(axes, scene)
    if move is not None:
        _draw_lane(axes, scene, reach, move.place, move.place_direction_deg, PLACE_LANE)
        _draw_lane(axes, scene, reach, move.pick, move.pick_direction_deg, PICK_LANE)
    if panel.target_direction_deg is not None:
        _draw_lane(axes, scene, reach, scene.target, panel.target_direction_deg, TARGET)
    size = RADIUS * scene.layout.cell_m
    usual: dict[int, ColorType] = {**dict.fromkeys(scene.obstacles, OBSTACLE), scene.target: TARGET}
    for cell, colour in usual.items():
        colour = colours.get(cell, colour)
        axes.add_patch(Circle(_on_paper(scene, cell), size, facecolor=colour, edgecolor="white", lw=0.8, zorder=4))
    if move is not None:
        edge = colours.get(move.pick, OBSTACLE)
        place = Circle(_on_paper(scene, move.place), size, facecolor="white", edgecolor=edge, lw=1.2, zorder=4)
        place.set_linestyle((0, (2.5, 1.5)))
        axes.add_patch(place)
        _draw_arrow(axes, scene, move.pick, move.place, panel.number)


def _draw_cells(axes: Axes, scene: Scene) -> None:
    """The cells with their ids, and the robot's side."""
    edge = scene.layout.cell_m
    for cell in range(scene.layout.n_cells):
        x, y = _on_paper(scene, cell)
        square = Rectangle((x - edge / 2, y - edge / 2), edge, edge, facecolor="#f6f6f4", edgecolor="#d4d5d8", lw=0.7)
        axes.add_patch(square)
        axes.text(
            x - 0.45 * edge, y + 0.44 * edge, str(cell_id(cell)), fontsize=5, color=FAINT, ha="left", va="top", zorder=6
        )
    bottom = axes.get_ylim()[0]
    middle = sum(axes.get_xlim()) / 2
    axes.text(middle, bottom, "▲ robot", fontsize=6.5, color=FAINT, ha="center", va="bottom", zorder=6)


def _draw_lane(axes: Axes, scene: Scene, reach: Reach, cell: int, direction_deg: float, colour: str) -> None:
    """The strip from a cell towards the robot that the hand needs free, to the panel's lower edge."""
    x, y = scene.layout.cells[cell]
    angle = math.atan2(-y, -x) + math.radians(direction_deg)
    ahead = (-math.sin(angle), math.cos(angle))
    aside = (ahead[1], -ahead[0])
    right, up = _on_paper(scene, cell)
    r, length = reach.clearance_m, 10 * max(x for x, _ in scene.layout.cells)
    strip = [
        (right + s * r * aside[0] + t * ahead[0], up + s * r * aside[1] + t * ahead[1])
        for s, t in ((-1, 0), (-1, length), (1, length), (1, 0))
    ]
    (left, right_end), top = axes.get_xlim(), axes.get_ylim()[1]
    # Clipped to the cells: the robot's strip stays clean, so that its label can be read.
    front = scene.layout.front_m
    above = Rectangle((left, front), right_end - left, top - front, transform=axes.transData)
    for patch in (
        Polygon(strip, facecolor=colour, alpha=0.16, lw=0, zorder=2),
        Polygon(strip, facecolor="none", edgecolor=colour, alpha=0.55, lw=0.7, zorder=2),
    ):
        axes.add_patch(patch)
        patch.set_clip_path(above)


def _draw_arrow(axes: Axes, scene: Scene, pick: int, place: int, number: int) -> None:
    """A bent arrow from object to place, the move's number on the object."""
    start, end = _on_paper(scene, pick), _on_paper(scene, place)
    # Bent towards the far side, away from the robot's label.
    bend = -0.22 if end[0] >= start[0] else 0.22
    radius_points = CELL_INCH * RADIUS * 72
    arrow = FancyArrowPatch(
        start,
        end,
        connectionstyle=f"arc3,rad={bend}",
        arrowstyle="-|>",
        mutation_scale=8,
        shrinkA=radius_points,
        shrinkB=radius_points,
        color=INK,
        lw=1.3,
        zorder=5,
    )
    axes.add_patch(arrow)
    axes.text(
        *start,
        str(number),
        fontsize=8.5,
        color="white",
        weight="bold",
        ha="center",
        va="center_baseline",
        zorder=7,
    )


def _draw_legend(figure: Figure, names: tuple[str, ...], columns: int, scale: float = 1.0) -> None:
    """What the colours mean: these lines of LEGEND."""
    handles = [Patch(facecolor=LEGEND[name][0], alpha=LEGEND[name][1], label=name) for name in names]
    figure.legend(
        handles=handles,
        loc="lower center",
        ncols=columns,
        frameon=False,
        fontsize=7 * scale,
        labelcolor=INK,
        handlelength=1.2,
        handleheight=0.9,
        columnspacing=1.4,
        borderaxespad=0.5,
    )
