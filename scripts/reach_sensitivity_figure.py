"""The sensitivity study's picture: distances over the grid, and the nearest point beside the paper's rows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import IO

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from scripts.paper_rows import REARRANGEMENTS
from scripts.reach_sensitivity_rows import Distance, Point, Row

INK, PAPER, OPTIMUM, BASELINE = "#2b2d33", "#8b8f98", "#2e8b57", "#c8553d"
MOST = 3.0
"""Where the colours end, rearrangements."""
BESIDE = 0.08
"""The paper's points stand so far to the right of ours, and ours to the left, so that their bars do not overlap."""
DPI = 160


def draw(file: IO[bytes], found: Mapping[Point, Mapping[str, Distance]], best: Point, check: Sequence[Row]) -> None:
    """Write the PNG: a row a board; heat maps of both distances at the best point's corridor, then its curves."""
    figure = Figure((13.0, 7.6), facecolor="white", layout="constrained")
    panels = figure.subplots(len(REARRANGEMENTS), 3, width_ratios=(1, 1, 1.25))
    corridor = best[2:]
    where = "as wide as the clearance" if best.corridor_m is None else f"{best.corridor_m:g} m"
    for row, board in enumerate(REARRANGEMENTS):
        here = {point[:2]: boards[board] for point, boards in found.items() if point[2:] == corridor}
        heat = _heat(panels[row, 0], here, lambda one: one.dqn, best)
        _heat(panels[row, 1], here, lambda one: one.baseline, best)
        panels[row, 0].set_title(f"{board}: optimum from the paper's DQN", fontsize=10, color=INK)
        panels[row, 1].set_title(f"{board}: baseline from the paper's", fontsize=10, color=INK)
        _curves(panels[row, 2], board, [one for one in check if one.board == board])
    _colour_bar(figure, heat, panels)
    avoids = ", corridors avoided" if best.avoid_corridors else ""
    figure.suptitle(
        f"Root mean square distances from Tables 2 and 3, in rearrangements; the baseline's corridor {where}{avoids}",
        fontsize=11,
        color=INK,
    )
    figure.savefig(file, format="png", dpi=DPI)


def _heat(
    axes: Axes, here: Mapping[tuple[float, float], Distance], of: Callable[[Distance], float], best: Point
) -> ScalarMappable:
    """Distances over clearance and fan, each written in its cell, the best point framed."""
    clearances, fans = (sorted({reach[axis] for reach in here}) for axis in (0, 1))
    values = np.array([[of(here[clearance, fan]) for fan in fans] for clearance in clearances])
    image = axes.imshow(values, origin="lower", aspect="auto", cmap="viridis_r", vmin=0.0, vmax=MOST)
    for (row, column), value in np.ndenumerate(values):
        text = "-" if np.isnan(value) else f"{value:.2f}"
        colour = "white" if value > 0.45 * MOST else INK
        axes.text(column, row, text, ha="center", va="center", fontsize=8, color=colour)
    corner = (fans.index(best.half_fan_deg) - 0.5, clearances.index(best.clearance_m) - 0.5)
    axes.add_patch(Rectangle(corner, 1, 1, fill=False, edgecolor=BASELINE, lw=2.5, clip_on=False, zorder=3))
    axes.set_xticks(range(len(fans)), [f"{fan:g}" for fan in fans])
    axes.set_yticks(range(len(clearances)), [f"{clearance:g}" for clearance in clearances])
    axes.set_xlabel("half fan, degrees", fontsize=9, color=INK)
    axes.set_ylabel("clearance, m", fontsize=9, color=INK)
    axes.tick_params(labelsize=8, colors=INK, length=0)
    axes.spines[:].set_visible(False)
    return image


def _colour_bar(figure: Figure, heat: ScalarMappable, panels: np.ndarray) -> None:
    bar = figure.colorbar(
        heat, ax=panels[:, :2].ravel().tolist(), location="bottom", shrink=0.5, aspect=40, extend="max"
    )
    bar.set_label("distance, rearrangements", fontsize=9, color=INK)
    bar.ax.tick_params(labelsize=8, colors=INK)


def _curves(axes: Axes, board: str, columns: Sequence[Row]) -> None:
    """The best point's means beside the paper's, with 95 % intervals."""
    obstacles = np.array([row.obstacles for row in columns])
    paper = REARRANGEMENTS[board]
    for name, label, colour in (("dqn", "DQN", OPTIMUM), ("baseline", "baseline", BASELINE)):
        cells = [paper[name][z] for z in obstacles.tolist()]
        axes.errorbar(
            obstacles + BESIDE,
            [cell.mean for cell in cells],
            [cell.half95 for cell in cells],
            fmt="o--",
            color=colour,
            alpha=0.55,
            mfc="white",
            ms=5,
            lw=1.2,
            capsize=3,
            label=f"paper, {label}",
        )
    ours = (
        ("optimum", OPTIMUM, [(row.optimum_mean, row.optimum_low, row.optimum_high) for row in columns]),
        (
            "baseline, where it solves",
            BASELINE,
            [(row.baseline_mean, row.baseline_low, row.baseline_high) for row in columns],
        ),
    )
    for label, colour, estimates in ours:
        mean, low, high = np.array(estimates).T
        axes.errorbar(
            obstacles - BESIDE,
            mean,
            [mean - low, high - mean],
            fmt="o-",
            color=colour,
            ms=5,
            lw=1.6,
            capsize=3,
            label=label,
        )
    axes.set_title(f"{board}: the framed point", fontsize=10, color=INK)
    axes.set_xlabel("obstacles", fontsize=9, color=INK)
    axes.set_ylabel("rearrangements", fontsize=9, color=INK)
    axes.set_xticks(obstacles)
    axes.set_ylim(bottom=0)
    axes.grid(color="#e6e6e6", lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8, colors=INK)
    axes.legend(fontsize=8, frameon=False, loc="upper left")
