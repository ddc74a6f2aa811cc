"""Q-values over the board: what the pick network makes of each obstacle, and, once the one that it would pick is
lifted, the place network of each cell.

python -m scripts.q_maps [--model FILE] [--out docs/results/q_values.png]
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Patch, Rectangle
from torch import Tensor

from dore.app import build
from dore.draw.board_art import CELL_INCH, FAINT, INK, OBSTACLE_COLOUR, RADIUS, TARGET_COLOUR
from dore.errors import InputError
from dore.files import atomic_write
from dore.learn.agents.sequential import Sequential
from dore.learn.checkpoint import SHIPPED
from dore.planners.learned import Learned
from dore.world.generator import Difficulty
from dore.world.instances import InstanceSet, problems_of
from dore.world.problem import Batch, Scene, cell_id
from dore.world.reach import Reach
from dore.world.rules import legal_moves, legal_places
from scripts.planner_timing import composed

DPI = 160
CMAP = colormaps["viridis"]
EMPTY, ILLEGAL, EDGE = "#f6f6f4", "#dcdde0", "#c9cace"
CHOICE = "#d62728"
GAP_INCH, TITLE_INCH, FOOT_INCH = 0.75, 0.5, 0.45
"""Right of a board, for its colour bar; above it; below all, for the legend."""
AROUND = (0.05, 0.55)
"""Around a board and below it, in cells."""
AMONG = 100
"""Instances among which a board with the wanted optimum is looked for."""


@dataclass(frozen=True)
class Wanted:
    """Which board to draw: the first of the validation split's that needs so many moves."""

    layout: str
    obstacles: int
    optimum: int
    about: str


BOARDS = (
    Wanted("6x6", 7, 1, "an easy one"),
    Wanted("8x8", 13, 3, "a hard one"),
    Wanted("9x9", 16, 2, "a size never seen"),
)


@dataclass(frozen=True)
class Map:
    """One network's values on a board: Float[G], and Bool[G], which of them it may choose from."""

    scene: Scene
    values: Tensor
    legal: Tensor

    @property
    def choice(self) -> int:
        """The greedy one's cell."""
        return int(self.values.masked_fill(~self.legal, -torch.inf).argmax())


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the PNG; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", type=Path, default=SHIPPED, help="a run directory or a model file")
    parser.add_argument("--out", type=Path, default=Path("docs/results/q_values.png"))
    chosen = parser.parse_args(arguments)
    torch.set_num_threads(1)
    try:
        drawn = [(wanted, maps_of(wanted, chosen.model)) for wanted in BOARDS]
    except InputError as error:
        print(f"q_maps: {error}", file=sys.stderr)
        return 2
    chosen.out.parent.mkdir(parents=True, exist_ok=True)
    draw(chosen.out, drawn)
    print(chosen.out)
    return 0


def maps_of(wanted: Wanted, model: Path) -> tuple[Map, Map]:
    """The pick network's map, and the place network's after the lift.

    Raises:
        InputError: no such model, one without a pick and a place network, or no such board.
    """
    cfg = composed([f"layout={wanted.layout}", "reach=wide_hand", "planner=[learned,exact]", f"model={model}"])
    reach = build.reach_of(cfg, "cpu")
    learned, exact = build.planners_of(cfg, reach)
    if not isinstance(learned, Learned) or not isinstance(learned.agent, Sequential):
        raise InputError(f"--model: {model} has no pick and place network, want one of agent=sequential")
    difficulty = Difficulty(wanted.obstacles, wanted.obstacles)
    instances = InstanceSet.generate(reach, AMONG, difficulty, "validation", seed=0)
    rows = [row for row, plan in enumerate(exact.plan(instances.batch())) if plan.optimal_moves == wanted.optimum]
    if not rows:
        raise InputError(f"{wanted.layout}: none of {AMONG} boards needs {wanted.optimum} moves")
    return _values(reach, learned.agent, instances.batch(slice(rows[0], rows[0] + 1)))


@torch.no_grad()
def _values(reach: Reach, agent: Sequential, start: Batch) -> tuple[Map, Map]:
    """Both maps of one instance."""
    board, target = start
    visited = board[:, None]
    (problem,) = problems_of(reach, start)
    scene = problem.scene
    pick = Map(scene, agent.pick_values(board, target)[0], legal_moves(reach, board, target, visited).pick[0])
    cell = torch.tensor([pick.choice])
    left = Scene(scene.layout, tuple(one for one in scene.obstacles if one != pick.choice), scene.target)
    legal = legal_places(reach, board, target, visited, cell)[0]
    return pick, Map(left, agent.move_values(board, target, cell)[0], legal)


def draw(path: Path, drawn: Sequence[tuple[Wanted, tuple[Map, Map]]]) -> None:
    """Write the PNG: a column a board, its picks above its places; all cells are of one size."""
    spans = [_extent(maps[0].scene) for _, maps in drawn]
    widths = [CELL_INCH * (right - left) for left, right, _, _ in spans]
    heights = [CELL_INCH * (top - bottom) for _, _, bottom, top in spans]
    down = max(heights) + TITLE_INCH
    size = (sum(widths) + GAP_INCH * len(drawn) + 0.15, 2 * down + FOOT_INCH)
    figure = Figure(size, facecolor="white")
    left = 0.15
    for (wanted, maps), span, width, height in zip(drawn, spans, widths, heights, strict=True):
        for one, bottom, title in zip(maps, (FOOT_INCH + down, FOOT_INCH), _titles(wanted, maps), strict=True):
            box = (left / size[0], bottom / size[1], width / size[0], height / size[1])
            axes = figure.add_axes(box, xlim=span[:2], ylim=span[2:])
            axes.set_title(title, fontsize=9, color=INK, pad=4)
            colours = _board(axes, one)
            beside = ((left + width + 0.06) / size[0], (bottom + 0.3 * height) / size[1])
            bar = figure.colorbar(colours, cax=figure.add_axes((*beside, 0.1 / size[0], 0.5 * height / size[1])))
            bar.ax.tick_params(labelsize=6.5, colors=INK, pad=2)
        x, y = _on_paper(maps[0].scene, maps[0].choice)
        axes.add_patch(Circle((x, y), RADIUS, fill=False, edgecolor=OBSTACLE_COLOUR, lw=1.2, ls=(0, (3, 2))))
        left += width + GAP_INCH
    _legend(figure)
    with atomic_write(path, "wb") as file:
        figure.savefig(file, format="png", dpi=DPI)


def _titles(wanted: Wanted, maps: tuple[Map, Map]) -> tuple[str, str]:
    """What stands above a board's two maps."""
    pick, place = (cell_id(one.choice) for one in maps)
    size = wanted.layout.replace("x", " x ")
    moves = f"{wanted.optimum} move" + "s" * (wanted.optimum != 1)
    return f"{size}, {wanted.about}: {moves} needed\npick {pick}", f"place {pick} on {place}"


def _legend(figure: Figure) -> None:
    handles = [
        Patch(facecolor=TARGET_COLOUR, label="target"),
        Patch(facecolor=OBSTACLE_COLOUR, label="obstacle"),
        Patch(facecolor="white", edgecolor=OBSTACLE_COLOUR, ls="--", label="lifted from here"),
        Patch(facecolor="white", edgecolor=CHOICE, lw=2, label="the greedy choice"),
        Patch(facecolor=ILLEGAL, label="cannot be chosen"),
    ]
    figure.legend(handles=handles, loc="lower center", ncols=5, fontsize=8.5, frameon=False, labelcolor=INK)


def _extent(scene: Scene) -> tuple[float, float, float, float]:
    """Left, right, bottom and top of a board, in cells: with a strip for the robot's side."""
    xs, ys = zip(*(_on_paper(scene, cell) for cell in range(scene.layout.n_cells)), strict=True)
    around, below = 0.5 + AROUND[0], 0.5 + AROUND[1]
    return min(xs) - around, max(xs) + around, min(ys) - below, max(ys) + around


def _on_paper(scene: Scene, cell: int) -> tuple[float, float]:
    """Where a cell's middle is drawn, in cells: right is the robot's right, up is away from it."""
    x, y = scene.layout.cells[cell]
    return -y / scene.layout.cell_m, x / scene.layout.cell_m


def _board(axes: Axes, one: Map) -> ScalarMappable:
    """One map: what may be chosen coloured by its value, the rest grey."""
    scene, values = one.scene, one.values[one.legal]
    colours = ScalarMappable(Normalize(float(values.min()), float(values.max())), CMAP)
    digits = 2 if float(values.max() - values.min()) < 10 else 1
    standing = {**dict.fromkeys(scene.obstacles, OBSTACLE_COLOUR), scene.target: TARGET_COLOUR}
    for cell in range(scene.layout.n_cells):
        x, y = _on_paper(scene, cell)
        legal = bool(one.legal[cell])
        fill = colours.to_rgba(float(one.values[cell])) if legal else ILLEGAL
        axes.add_patch(Rectangle((x - 0.5, y - 0.5), 1, 1, facecolor=fill, edgecolor=EDGE, lw=0.6))
        dark = legal and sum(fill[:3]) < 1.5
        ink = "white" if dark else INK
        axes.text(x - 0.44, y + 0.44, str(cell_id(cell)), fontsize=4.5, color="white" if dark else FAINT, va="top")
        if cell in standing:
            axes.add_patch(Circle((x, y), RADIUS, facecolor=standing[cell], edgecolor="white", lw=0.8, zorder=2))
            ink = "white"
        if legal:
            text = f"{float(one.values[cell]):.{digits}f}"
            axes.text(x, y, text, fontsize=6, color=ink, ha="center", va="center_baseline", zorder=3)
    x, y = _on_paper(scene, one.choice)
    axes.add_patch(Rectangle((x - 0.46, y - 0.46), 0.92, 0.92, fill=False, edgecolor=CHOICE, lw=2.2, zorder=4))
    (left, right), bottom = axes.get_xlim(), axes.get_ylim()[0]
    axes.text((left + right) / 2, bottom, "▲ robot", fontsize=7, color=FAINT, ha="center", va="bottom")
    axes.axis("off")
    return colours


if __name__ == "__main__":
    sys.exit(main())
