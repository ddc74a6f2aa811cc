"""The camera's picture: a frame with the detections drawn over it, beside the board as they make it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from dore.draw.board_art import OBSTACLE_COLOUR, TARGET_COLOUR, draw_cells
from dore.draw.style import BLUE, INK, save_figure
from dore.sim.frames import Array, pixels_of
from dore.sim.vision.perception import Frame
from dore.sim.vision.scene_estimate import Detection, Shape, cell_of
from dore.world.layout import Layout
from dore.world.problem import cell_id
from scripts.arrangements import Arrangement

_TO_PAPER = np.array([[0, 1], [-1, 0]])
"""Right is the robot's right, up is away from it."""


def draw(path: Path, frame: Frame, seen: Sequence[Detection], placed: Arrangement) -> None:
    """Write the PNG."""
    figure = Figure((13.2, 3.6), facecolor="white", layout="constrained")
    picture, depth, board = figure.subplots(1, 3, width_ratios=(1, 1, 1.25))
    picture.imshow(frame.rgb)
    picture.set_title("The camera faces the robot; what was seen is outlined", fontsize=9.5, color=INK)
    depth.set_facecolor("black")
    depth.imshow(np.where(frame.depth_m > 0, frame.depth_m, np.nan), cmap="viridis_r", vmin=0.8, vmax=1.25)
    depth.set_title("Depth: near is light, black was not measured", fontsize=9.5, color=INK)
    for axes in (picture, depth):
        axes.set(xticks=[], yticks=[])
    for one in seen:
        _outline(picture, frame, one, placed.layout)
    _board(board, seen, placed)
    save_figure(figure, path, dpi=160)


def _footprint(half_width: float, yaw: float, shape: Shape) -> Array:
    """Float64[N, 2]: the outline about its middle, metres."""
    if shape == "cylinder":
        angle = np.linspace(0, math.tau, 40)
        return half_width * np.column_stack([np.cos(angle), np.sin(angle)])
    angle = yaw + math.pi / 4 + np.arange(5) * math.pi / 2
    return half_width * math.sqrt(2) * np.column_stack([np.cos(angle), np.sin(angle)])


def _outline(axes: Axes, frame: Frame, one: Detection, layout: Layout) -> None:
    """The outline of the top face, and the cell's id on it."""
    edge = _footprint(one.half_width_m, one.yaw_rad, one.shape) + one.xy
    top = np.column_stack([edge, np.full(len(edge), one.height_m)])
    # imshow puts the middle of pixel (0, 0) at (0, 0).
    pixels = pixels_of(top, frame.intrinsic, frame.camera_to_world)[0] - 0.5
    axes.add_patch(Polygon(pixels, fill=False, edgecolor="white", lw=2.6))
    axes.add_patch(Polygon(pixels, fill=False, edgecolor=TARGET_COLOUR if one.is_target else INK, lw=1.2))
    cell = cell_of(one, layout)
    text = "off" if cell is None else str(cell_id(cell))
    axes.text(*pixels[:-1].mean(0), text, fontsize=8, color="white", weight="bold", ha="center", va="center_baseline")


def _board(axes: Axes, seen: Sequence[Detection], placed: Arrangement) -> None:
    """The cells from above, the robot below; what was seen filled, the truth as thin outlines."""
    draw_cells(axes, placed.scene)
    for one in seen:
        outline = (_footprint(one.half_width_m, one.yaw_rad, one.shape) + one.xy) @ _TO_PAPER
        colour = TARGET_COLOUR if one.is_target else OBSTACLE_COLOUR
        axes.add_patch(Polygon(outline, facecolor=colour, edgecolor="none"))
    for body, xy, yaw in zip(placed.bodies, placed.xy, placed.yaws_rad, strict=True):
        outline = (_footprint(body.half_width_m, float(yaw), body.shape) + xy) @ _TO_PAPER
        axes.add_patch(Polygon(outline, fill=False, edgecolor=BLUE, lw=0.9))
    axes.set_title("The board as seen, from the robot's side", fontsize=9.5, color=INK)
    handles = [
        Patch(facecolor=TARGET_COLOUR, label="target"),
        Patch(facecolor=OBSTACLE_COLOUR, label="obstacle"),
        Line2D([], [], color=BLUE, lw=0.9, label="where it truly stands"),
    ]
    axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=3, frameon=False, fontsize=8)
