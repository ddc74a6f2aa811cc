"""The elements of a drawn board: cells, approach corridors, arrows and legend."""

from __future__ import annotations

import math

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, Patch, Polygon, Rectangle

from dore.draw.style import BLUE, EDGE, EMPTY, FAINT, GREEN, INK, OCHRE, RED
from dore.world.problem import Problem, Scene, cell_id

OBSTACLE_COLOUR, TARGET_COLOUR, PICK_CORRIDOR_COLOUR, PLACE_CORRIDOR_COLOUR = RED, GREEN, BLUE, OCHRE
CELL_INCH = 0.46
"""Edge of a cell on paper; everything else follows from it, so text never crowds the cells."""
RADIUS = 0.3
"""Radius of an object as drawn, in cells; the physical one is part of the reach's clearance."""
LEGEND = {
    "obstacle": (OBSTACLE_COLOUR, 1.0),
    "target and its corridor": (TARGET_COLOUR, 1.0),
    "pick corridor": (PICK_CORRIDOR_COLOUR, 0.5),
    "place corridor": (PLACE_CORRIDOR_COLOUR, 0.5),
}
"""What each colour means, with its opacity."""


def extent(scene: Scene) -> tuple[float, float, float, float]:
    """Left, right, bottom and top of a panel, metres: the cells and a strip for the robot's side."""
    half = scene.layout.cell_m / 2
    xs, ys = zip(*scene.layout.cells, strict=True)
    edge = 0.12 * half
    return -max(ys) - half - edge, -min(ys) + half + edge, min(xs) - 1.7 * half, max(xs) + half + edge


def on_paper(scene: Scene, cell: int) -> tuple[float, float]:
    """Where a cell's centre is drawn: right is the robot's right, up is away from it."""
    x, y = scene.layout.cells[cell]
    return -y, x


def draw_cells(axes: Axes, scene: Scene) -> None:
    """The cells with their ids, and the robot's side, on axes that then show the whole panel and no frame."""
    left, right, bottom, top = extent(scene)
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
    axes.axis("off")
    edge = scene.layout.cell_m
    for cell in range(scene.layout.n_cells):
        x, y = on_paper(scene, cell)
        square = Rectangle((x - edge / 2, y - edge / 2), edge, edge, facecolor=EMPTY, edgecolor=EDGE, lw=0.7)
        axes.add_patch(square)
        axes.text(
            x - 0.45 * edge, y + 0.44 * edge, str(cell_id(cell)), fontsize=5, color=FAINT, ha="left", va="top", zorder=6
        )
    axes.text((left + right) / 2, bottom, "▲ robot", fontsize=6.5, color=FAINT, ha="center", va="bottom", zorder=6)


def draw_corridor(axes: Axes, problem: Problem, cell: int, direction_deg: float, colour: str) -> None:
    """The strip from a cell towards the robot that must hold no obstacle's centre, to the panel's lower edge."""
    scene = problem.scene
    x, y = scene.layout.cells[cell]
    angle = math.atan2(-y, -x) + math.radians(direction_deg)
    ahead = (-math.sin(angle), math.cos(angle))
    aside = (ahead[1], -ahead[0])
    right, up = on_paper(scene, cell)
    r, length = problem.reach.clearance_m, 10 * max(x for x, _ in scene.layout.cells)
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


def draw_arrow(axes: Axes, scene: Scene, pick: int, place: int, number: int) -> None:
    """A bent arrow from object to place, the move's number on the object."""
    start, end = on_paper(scene, pick), on_paper(scene, place)
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


def draw_legend(figure: Figure, names: tuple[str, ...], columns: int, scale: float = 1.0) -> None:
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
