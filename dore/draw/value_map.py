"""A network's values on a board: legal cells coloured by value, the greedy choice framed, optimal ones marked."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.patches import Circle, Patch, Rectangle
from torch import Tensor

from dore.draw.board_art import OBSTACLE_COLOUR, RADIUS, TARGET_COLOUR, draw_cells, on_paper
from dore.draw.style import INK
from dore.world.problem import Scene

CMAP = colormaps["viridis"]
ILLEGAL, CHOICE, BEST = "#dcdde0", "#d62728", "white"


@dataclass(frozen=True)
class ValueMap:
    """One network's values on a board: Float[G], and Bool[G], which of them it may choose from.

    optimal: Bool[G], which choices a shortest plan makes. per_cent: the values are probabilities.
    """

    scene: Scene
    values: Tensor
    legal: Tensor
    optimal: Tensor
    per_cent: bool = False

    @property
    def choice(self) -> int:
        """The greedy one's cell."""
        return int(self.values.masked_fill(~self.legal, -torch.inf).argmax())

    @property
    def right(self) -> bool:
        """Whether a shortest plan makes the same choice."""
        return bool(self.optimal[self.choice])


def draw_map(axes: Axes, one: ValueMap) -> ScalarMappable:
    """Draw a map; what may not be chosen is grey. Returns the colour scale, for a colour bar."""
    scene, values, edge = one.scene, one.values[one.legal], one.scene.layout.cell_m
    low, high = (0.0, 100.0) if one.per_cent else (float(values.min()), float(values.max()))
    colours = ScalarMappable(Normalize(low, high), CMAP)
    fills = colours.to_rgba(one.values.numpy())
    digits = 2 if high - low < 10 else 1
    standing = {**dict.fromkeys(scene.obstacles, OBSTACLE_COLOUR), scene.target: TARGET_COLOUR}
    draw_cells(axes, scene)
    for cell in range(scene.layout.n_cells):
        x, y = on_paper(scene, cell)
        legal, value = bool(one.legal[cell]), float(one.values[cell])
        fill = fills[cell] if legal else ILLEGAL
        axes.add_patch(Rectangle((x - edge / 2, y - edge / 2), edge, edge, facecolor=fill, edgecolor="white", lw=0.6))
        if cell in standing:
            axes.add_patch(Circle((x, y), RADIUS * edge, facecolor=standing[cell], edgecolor="white", lw=0.8))
        if one.optimal[cell]:
            centre = x + 0.34 * edge, y + 0.34 * edge
            axes.add_patch(Circle(centre, 0.06 * edge, facecolor=BEST, edgecolor=INK, lw=0.8))
        if legal:
            ink = "white" if cell in standing or sum(fills[cell, :3]) < 1.5 else INK
            axes.text(x, y, f"{value:.{digits}f}", fontsize=6, color=ink, ha="center", va="center_baseline")
    x, y = on_paper(scene, one.choice)
    corner, size = (x - 0.46 * edge, y - 0.46 * edge), 0.92 * edge
    axes.add_patch(Rectangle(corner, size, size, fill=False, edgecolor=CHOICE, lw=2.2))
    return colours


def ring(scene: Scene, cell: int) -> Circle:
    """A dashed outline on the cell that an obstacle was lifted from."""
    outline = Circle(on_paper(scene, cell), RADIUS * scene.layout.cell_m, fill=False, lw=1.2)
    outline.set(edgecolor=OBSTACLE_COLOUR, linestyle=(0, (3, 2)))
    return outline


def map_legend() -> list[Patch]:
    """What the marks of a map mean."""
    return [
        Patch(facecolor=TARGET_COLOUR, label="target"),
        Patch(facecolor=OBSTACLE_COLOUR, label="obstacle"),
        Patch(facecolor="white", edgecolor=OBSTACLE_COLOUR, ls="--", label="lifted from here"),
        Patch(facecolor="white", edgecolor=CHOICE, lw=2, label="the greedy choice"),
        Patch(facecolor=BEST, edgecolor=INK, label="a shortest plan's choice"),
        Patch(facecolor=ILLEGAL, label="cannot be chosen"),
    ]
