"""The measured reach of an arm as a page, a CSV with a row for each lane, and a picture."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import IO

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle, Wedge
from torch import Tensor

from dore.files import atomic_write, commit
from dore.report.tables import as_markdown
from dore.sim.config import ArmConfig
from dore.world.problem import cell_id
from dore.world.reach import Reach
from scripts.measure_reach import Survey

INK, GRID, ALLOWED, FOLLOWED, TOUCHED, BUG = "#2b2d33", "#b9bdc6", "#bfe0cb", "#2e8b57", "#c8553d", "#d11149"
DPI = 160
COLUMNS = (
    "cell", "sector", "direction_deg", "allowed", "followed", "why_not", "blocking_cells",
    "touched_by_empty_hand", "touched_when_loaded",
)  # fmt: skip


def write_report(
    report: Path, found: Survey, arm: ArmConfig, half_hand_m: float, objects: str, seconds: float, command: str
) -> None:
    """Write REPORT.csv, REPORT.png and REPORT.md."""
    report.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(report.with_suffix(".csv")) as file:
        _write_rows(file, found)
    with atomic_write(report.with_suffix(".png"), "wb") as file:
        _draw(file, found, arm)
    with atomic_write(report.with_suffix(".md")) as file:
        file.write(_page(report.name, found, arm, half_hand_m, objects, seconds, command))


def _write_rows(file: IO[str], found: Survey) -> None:
    writer, reach, blocking = csv.writer(file, lineterminator="\n"), found.reach, found.blocking
    writer.writerow(COLUMNS)
    for (cell, sector), why in found.why.items():
        here = cell, sector
        cells = (_ids(one[here]) for one in (blocking, found.empty, found.loaded))
        allowed, followed = int(reach.allowed_sectors[here]), int(found.followed[here])
        writer.writerow([cell_id(cell), sector, f"{reach.sectors_deg[sector]:.3f}", allowed, followed, why, *cells])


def _ids(cells: Tensor) -> str:
    return " ".join(str(cell_id(cell)) for cell in cells.nonzero().flatten().tolist())


def _page(
    name: str, found: Survey, arm: ArmConfig, half_hand_m: float, objects: str, seconds: float, command: str
) -> str:
    reach, layout = found.reach, found.reach.layout
    rows, cols = layout.grid_shape or (1, layout.n_cells)
    allowed, lanes = reach.allowed_sectors, reach.allowed_sectors[..., None]
    pairs = int(lanes.sum()) * (reach.n_cells - 1)
    off = found.off_lane_m()[found.touched & lanes]
    widest = f"{1e3 * float(off.max()):.1f} mm" if len(off) else "no distance: nothing was touched"
    table = [
        ["", "all", "by the rule", "measured", "rule lets, arm cannot", "arm can, rule forbids"],
        [
            "lanes to follow", str(allowed.numel()), str(int(allowed.sum())), str(int(found.followed.sum())),
            str(int(found.not_followed.sum())), str(int((found.followed & ~allowed).sum())),
        ],
        [
            "(allowed lane, other cell) free", str(pairs), str(pairs - int((found.blocking & lanes).sum())),
            str(pairs - int((found.touched & lanes).sum())), str(int(found.not_blocked.sum())),
            str(int((found.blocking & ~found.touched & lanes).sum())),
        ],
    ]  # fmt: skip
    return "\n".join([
        f"# What `arm={arm.name}` can reach, and `reach={arm.name}`",
        "",
        f"`{command}`, commit {commit()}; objects={objects}, {rows} x {cols} cells of {layout.cell_m:g} m, front edge "
        f"at {layout.front_m:g} m; {seconds:.0f} s on one core.",
        "",
        as_markdown(table),
        "",
        "A lane is followed when the arm goes there at grasp height and back lifted, by inverse kinematics on one "
        "joint branch, within its limits, without touching the table, itself or the object it reaches for, and on its "
        "way along the staging line with an object on every cell. A cell is free for a lane when an object on it "
        f"stays {1e3 * arm.clearance_m:g} mm from the arm, going in empty and coming out with an object. All objects "
        "are as wide as the widest that is drawn, however it is turned.",
        "",
        f"The open hand is {1e3 * half_hand_m:.1f} mm to either side; the rule's clearance is "
        f"{1e3 * reach.clearance_m:g} mm, of which {1e3 * arm.corridor_margin_m:g} mm are margin. Objects were touched "
        f"up to {widest} from a lane's line, so much clearance is needed.",
        "",
        f"![The lanes, and how far from a lane objects are touched]({name}.png)",
        "",
        f"One row a lane: [{name}.csv]({name}.csv).",
        "",
    ])  # fmt: skip


def _draw(file: IO[bytes], found: Survey, arm: ArmConfig) -> None:
    figure = Figure((12.5, 5.4), facecolor="white", layout="constrained")
    table, histogram = figure.subplots(1, 2, width_ratios=(1.5, 1))
    _draw_lanes(table, found)
    _draw_distances(histogram, found)
    figure.suptitle(f"arm={arm.name}: what it follows and what the planners may use", fontsize=11, color=INK)
    figure.savefig(file, format="png", dpi=DPI)


def _draw_lanes(axes: Axes, found: Survey) -> None:
    """Seen from above, the robot below; each cell's fan filled where allowed, a line where followed."""
    reach, layout = found.reach, found.reach.layout
    apex = 0.16 * layout.cell_m
    radius, step = 0.62 * layout.cell_m, float(reach.sectors_deg[1] - reach.sectors_deg[0])
    for cell, (x, y) in enumerate(layout.cells):
        corner = (-y - layout.cell_m / 2, x - layout.cell_m / 2)
        axes.add_patch(Rectangle(corner, layout.cell_m, layout.cell_m, fill=False, edgecolor=GRID, lw=1))
        # On paper +x of the robot points up and its left is left: an angle a of the world is drawn at a + 90.
        to_base = np.degrees(np.arctan2(-y, -x)) + 90.0
        for sector, direction in enumerate(reach.sectors_deg.tolist()):
            angle = to_base + direction
            if reach.allowed_sectors[cell, sector]:
                wedge = Wedge(
                    (-y, x + apex), radius, angle - step / 2, angle + step / 2, facecolor=ALLOWED, edgecolor="none"
                )
                axes.add_patch(wedge)
            if found.followed[cell, sector] or found.not_followed[cell, sector]:
                end = (-y + radius * np.cos(np.radians(angle)), x + apex + radius * np.sin(np.radians(angle)))
                colour = FOLLOWED if found.followed[cell, sector] else BUG
                axes.plot([-y, end[0]], [x + apex, end[1]], color=colour, lw=0.3, solid_capstyle="butt")
        axes.text(-y, x + 0.32 * layout.cell_m, str(cell_id(cell)), ha="center", va="center", fontsize=9, color=INK)
    _draw_staging(axes, reach)
    axes.set_aspect("equal")
    axes.set_title("filled: allowed; green line: followed; red line: allowed, not followed", fontsize=9, color=INK)
    axes.set_xlabel("to the robot's right, m", fontsize=9, color=INK)
    axes.set_ylabel("ahead of the robot, m", fontsize=9, color=INK)
    axes.tick_params(labelsize=8, colors=INK)
    axes.spines[:].set_visible(False)


def _draw_staging(axes: Axes, reach: Reach) -> None:
    x, side = reach.layout.front_m - reach.staging_m, reach.lateral_limit_m or 0.0
    axes.plot([-side, side], [x, x], color=INK, lw=1.5)
    axes.text(0.0, x - 0.02, f"staging line, {x:.2f} m ahead of the base", ha="center", va="top", fontsize=8, color=INK)
    axes.set_ylim(bottom=x - 0.06)


def _draw_distances(axes: Axes, found: Survey) -> None:
    """How far from the line of an allowed lane the objects stand that are touched, and those that are not."""
    off, lanes = 1e3 * found.off_lane_m(), found.reach.allowed_sectors[..., None]
    others = ~torch.eye(found.reach.n_cells, dtype=torch.bool)[:, None]
    near = lanes & others & (off < 2e3 * found.reach.clearance_m)
    bins = np.arange(0.0, 2e3 * found.reach.clearance_m + 2.5, 2.5)
    groups = (near & found.touched, near & ~found.touched)
    axes.hist(
        [off[group].numpy() for group in groups], bins=bins.tolist(), stacked=True, color=[TOUCHED, ALLOWED],
        label=["touched", "not touched"],
    )  # fmt: skip
    axes.axvline(1e3 * found.reach.clearance_m, color=INK, lw=1.2)
    axes.set_ylim(top=1.2 * axes.get_ylim()[1])
    axes.text(
        1e3 * found.reach.clearance_m + 2, 0.97, "the rule's clearance", transform=axes.get_xaxis_transform(),
        va="top", fontsize=8, color=INK,
    )  # fmt: skip
    axes.set_title("objects on other cells, by distance from an allowed lane's line", fontsize=9, color=INK)
    axes.set_xlabel("distance, mm", fontsize=9, color=INK)
    axes.set_ylabel("(lane, other cell)", fontsize=9, color=INK)
    axes.legend(fontsize=8, frameon=False, loc="upper left")
    axes.tick_params(labelsize=8, colors=INK)
    axes.spines[["top", "right"]].set_visible(False)
