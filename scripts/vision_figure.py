"""The camera's picture: a frame with the detections drawn over it, beside the board as they make it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import IO

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon, Rectangle

from dore.draw.board_art import FAINT, INK, OBSTACLE_COLOUR, TARGET_COLOUR
from dore.sim.motion.frames import Array
from dore.sim.vision.perception import Frame
from dore.sim.vision.scene_estimate import Detection, cell_of
from dore.world.layout import Layout
from dore.world.problem import cell_id
from scripts.vision_scenes import Arrangement

DPI = 160
_TRUTH = "#1f3a93"


def draw(file: IO[bytes], frame: Frame, seen: Sequence[Detection], placed: Arrangement) -> None:
    """Write the PNG."""
    figure = Figure((13.2, 3.6), facecolor="white", layout="constrained")
    shown, measured, board = figure.subplots(1, 3, width_ratios=(1, 1, 1.25))
    shown.imshow(frame.rgb)
    shown.set_title("The camera faces the robot; what was seen is outlined", fontsize=9.5, color=INK)
    depth = np.where(frame.depth_m > 0, frame.depth_m, np.nan)
    measured.set_facecolor("black")
    measured.imshow(depth, cmap="viridis_r", vmin=0.8, vmax=1.25)
    measured.set_title("Depth: near is light, black was not measured", fontsize=9.5, color=INK)
    for axes in (shown, measured):
        axes.set_xticks([])
        axes.set_yticks([])
    for one in seen:
        _outline(shown, frame, one, placed.layout)
    _board(board, seen, placed)
    figure.savefig(file, format="png", dpi=DPI)


def _footprint(half_width: float, yaw: float, is_round: bool) -> Array:
    """Float64[N, 2]: the outline about its middle, metres."""
    if is_round:
        angle = np.linspace(0, math.tau, 40)
        return half_width * np.column_stack([np.cos(angle), np.sin(angle)])
    angle = yaw + math.pi / 4 + np.arange(5) * math.pi / 2
    return half_width * math.sqrt(2) * np.column_stack([np.cos(angle), np.sin(angle)])


def _pixels(frame: Frame, points: Array) -> Array:
    """Float64[N, 2]: where points of the world are in the picture."""
    pose = frame.camera_to_world
    seen = (points - pose[:3, 3]) @ pose[:3, :3] @ frame.intrinsic.T
    # imshow puts the middle of pixel (0, 0) at (0, 0).
    return np.asarray(seen[:, :2] / seen[:, 2:] - 0.5)


def _outline(axes: Axes, frame: Frame, one: Detection, layout: Layout) -> None:
    """The outline of the top face, and the cell's id on it."""
    edge = _footprint(one.half_width_m, one.yaw_rad, one.shape == "cylinder") + one.xy
    pixels = _pixels(frame, np.column_stack([edge, np.full(len(edge), one.height_m)]))
    axes.add_patch(Polygon(pixels, fill=False, edgecolor="white", lw=2.6))
    axes.add_patch(Polygon(pixels, fill=False, edgecolor=TARGET_COLOUR if one.is_target else INK, lw=1.2))
    cell = cell_of(one, layout)
    text = "off" if cell is None else str(cell_id(cell))
    axes.text(*pixels[:-1].mean(0), text, fontsize=8, color="white", weight="bold", ha="center", va="center_baseline")


def _board(axes: Axes, seen: Sequence[Detection], placed: Arrangement) -> None:
    """The cells from above, the robot below; what was seen filled, the truth as thin outlines."""
    layout, half = placed.layout, placed.layout.cell_m / 2
    for cell, (x, y) in enumerate(layout.cells):
        axes.add_patch(Rectangle((-y - half, x - half), 2 * half, 2 * half, facecolor="#f6f6f4", edgecolor="#d4d5d8"))
        axes.text(-y - 0.92 * half, x + 0.9 * half, str(cell_id(cell)), fontsize=7, color=FAINT, va="top")
    for one in seen:
        outline = (_footprint(one.half_width_m, one.yaw_rad, one.shape == "cylinder") + one.xy) @ [[0, 1], [-1, 0]]
        axes.add_patch(
            Polygon(outline, facecolor=TARGET_COLOUR if one.is_target else OBSTACLE_COLOUR, edgecolor="none")
        )
    for body, xy, yaw in zip(placed.bodies, placed.xy, placed.yaws_rad, strict=True):
        outline = (_footprint(body.half_width_m, float(yaw), body.shape == "cylinder") + xy) @ [[0, 1], [-1, 0]]
        axes.add_patch(Polygon(outline, fill=False, edgecolor=_TRUTH, lw=0.9))
    near, far = layout.centres.numpy().min(0) - half, layout.centres.numpy().max(0) + half
    axes.set_xlim(-far[1] - 0.01, -near[1] + 0.01)
    axes.set_ylim(near[0] - 0.05, far[0] + 0.01)
    axes.text(-(far[1] + near[1]) / 2, near[0] - 0.04, "▲ robot", fontsize=8, color=FAINT, ha="center", va="bottom")
    axes.set_aspect("equal")
    axes.axis("off")
    axes.set_title("The board as seen, from the robot's side", fontsize=9.5, color=INK)
    handles = [
        Circle((0, 0), facecolor=TARGET_COLOUR, label="target"),
        Circle((0, 0), facecolor=OBSTACLE_COLOUR, label="obstacle"),
        Line2D([], [], color=_TRUTH, lw=0.9, label="where it truly stands"),
    ]  # fmt: skip
    axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=3, frameon=False, fontsize=8)
