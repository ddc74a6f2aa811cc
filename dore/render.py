"""A plan as a picture: a strip of boards, one a move. Matplotlib's objects, no global state."""

from __future__ import annotations

import math
import os

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrowPatch, Patch, Polygon, Rectangle

from dore.errors import atomic_write
from dore.plan import Plan, Scene, cell_id, replay
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


def draw_plan(scene: Scene, reach: Reach, plan: Plan, path: str | os.PathLike[str]) -> None:
    """Write a PNG with one panel a move and one for the retrieval, in reading order.

    The robot stands below each panel and looks up: row 0 is at the bottom, its left is on the left. A lane is as
    wide as twice the reach's clearance; obstacles' centres stay out of it.

    Raises:
        PlanError: the plan does not replay.
    """
    boards = replay(scene, reach, plan)
    left, right, bottom, top = _extent(scene)
    inch = CELL_INCH / scene.layout.cell_m
    width, height = (right - left) * inch, (top - bottom) * inch
    panels = len(plan.moves) + 1
    rows = math.ceil(panels / max(1, int((MAX_WIDTH_INCH - GAP_INCH) / (width + GAP_INCH))))
    columns = math.ceil(panels / rows)
    across, down = width + GAP_INCH, height + TITLE_INCH
    size = (max(columns * across + GAP_INCH, 4.9), rows * down + HEAD_INCH + FOOT_INCH)
    figure = Figure(size, facecolor="white")
    indent = (size[0] - columns * across + GAP_INCH) / 2
    for panel in range(panels):
        row, column = divmod(panel, columns)
        corner = (indent + column * across, size[1] - HEAD_INCH - (row + 1) * down)
        box = (corner[0] / size[0], corner[1] / size[1], width / size[0], height / size[1])
        axes = figure.add_axes(box, xlim=(left, right), ylim=(bottom, top))
        axes.axis("off")
        _draw_panel(axes, scene, reach, plan, panel, boards[panel])
    count = f"{len(plan.moves)} rearrangement" + "s" * (len(plan.moves) != 1)
    title = f"{plan.planner}: {plan.status.replace('_', ' ')}, {count}"
    figure.text(
        0.5, 1 - HEAD_INCH / 2 / size[1], title, ha="center", va="center", fontsize=11, color=INK, weight="bold"
    )
    _draw_legend(figure)
    with atomic_write(path, "wb") as file:
        figure.savefig(file, format="png", dpi=DPI)


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


def _draw_panel(axes: Axes, scene: Scene, reach: Reach, plan: Plan, panel: int, standing: set[int]) -> None:
    """One board and what happens on it: the move of that number, or the retrieval."""
    _draw_cells(axes, scene)
    move = plan.moves[panel] if panel < len(plan.moves) else None
    if move is not None:
        _draw_lane(axes, scene, reach, move.place, move.place_direction_deg, PLACE_LANE)
        _draw_lane(axes, scene, reach, move.pick, move.pick_direction_deg, PICK_LANE)
        title = f"{panel + 1}.  {cell_id(move.pick)} to {cell_id(move.place)}"
    elif plan.target_direction_deg is not None:
        _draw_lane(axes, scene, reach, scene.target, plan.target_direction_deg, TARGET)
        title = f"{panel + 1}.  retrieve {cell_id(scene.target)}"
    else:
        title = f"no way found to {cell_id(scene.target)}"
    axes.set_title(title, fontsize=9, color=INK, pad=3)
    size = RADIUS * scene.layout.cell_m
    for cell in standing:
        axes.add_patch(Circle(_on_paper(scene, cell), size, facecolor=OBSTACLE, edgecolor="white", lw=0.8, zorder=4))
    axes.add_patch(Circle(_on_paper(scene, scene.target), size, facecolor=TARGET, edgecolor="white", lw=0.8, zorder=4))
    if move is not None:
        place = Circle(_on_paper(scene, move.place), size, facecolor="white", edgecolor=OBSTACLE, lw=1.2, zorder=4)
        place.set_linestyle((0, (2.5, 1.5)))
        axes.add_patch(place)
        _draw_arrow(axes, scene, move.pick, move.place, panel + 1)


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


def _draw_legend(figure: Figure) -> None:
    """What the colours mean."""
    handles = [
        Patch(facecolor=OBSTACLE, label="obstacle"),
        Patch(facecolor=TARGET, label="target and its lane"),
        Patch(facecolor=PICK_LANE, alpha=0.5, label="lane of the pick"),
        Patch(facecolor=PLACE_LANE, alpha=0.5, label="lane of the place"),
    ]
    figure.legend(
        handles=handles,
        loc="lower center",
        ncols=4,
        frameon=False,
        fontsize=7,
        labelcolor=INK,
        handlelength=1.2,
        handleheight=0.9,
        columnspacing=1.4,
        borderaxespad=0.5,
    )
