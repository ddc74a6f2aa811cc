"""What the arm can follow, corridor by corridor, against what its reach lets the planners ask for.

python -m scripts.measure_reach out=FOLDER [arm=panda_slim] [objects=mixed] [rows=3] [cols=6] [cell_m=0.12] ...
Every (cell, sector): there and back by inverse kinematics on the arm's branch, empty at grasp height and loaded above
it, without touching the table, itself or the object in the cell, nor anything on the way along the staging line.
Every (cell, sector, other cell): whether an object there is touched by the empty hand going in, or by the arm with an
object coming out. All objects are cans as wide as the widest that is ever drawn, however it is turned.
FOLDER/corridors/rows.csv has a row a corridor, and FOLDER/objects/rows.csv one for each object near an allowed one;
`dore-report study=reach_panda_slim` makes the page.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import NamedTuple

import pandas as pd
import torch
from omegaconf import OmegaConf
from torch import Tensor

from dore.report.measurements import write_measurements
from dore.sim.config import ArmConfig, ObjectConfig, preset
from dore.sim.motion.arm_reach import arm_reach, follow_corridor
from dore.sim.motion.collision import TABLE_OVERHANG_M, CollisionChecker, Held, Standing
from dore.sim.motion.kinematics import ArmKinematics, Unreachable
from dore.sim.scene.urdf import arm_files
from dore.world.board import unpack
from dore.world.layout import Layout
from dore.world.reach import Reach
from scripts.program import run


@dataclass(frozen=True)
class Options:
    """out: the folder of the rows. arm, objects: of conf/. arm_keys: other values of the arm's, as urdf=PATH."""

    out: Path
    arm: str = "panda_slim"
    objects: str = "mixed"
    rows: int = 3
    cols: int = 6
    cell_m: float = 0.12
    front_m: float = 0.5
    arm_keys: list[str] = field(default_factory=list)


class Found(NamedTuple):
    """One corridor. why_not: what hinders the arm, empty where it follows when nothing else stands on the table.

    empty, loaded: the cells whose objects it touches going in, and coming out; none are looked for where it does not
    follow.
    """

    why_not: str = ""
    empty: frozenset[int] = frozenset()
    loaded: frozenset[int] = frozenset()


class Surveyor:
    """Measures corridors of one arm, its objects and a layout.

    Raises:
        Unreachable: the arm cannot reach the middle of the staging line.
    """

    def __init__(self, arm: ArmConfig, objects: ObjectConfig, layout: Layout) -> None:
        self.layout = layout
        self.kinematics = ArmKinematics(arm_files(visuals=False, arm=arm), arm)
        self.reach = arm_reach(arm, objects, layout, self.kinematics)
        everywhere = [objects.widest] * layout.n_cells
        self._checker = CollisionChecker(self.kinematics, everywhere, layout.front_m - TABLE_OVERHANG_M)
        self._all = {cell: Standing(xy) for cell, xy in enumerate(layout.cells)}
        self._ready = self.kinematics.ready(layout.front_m - arm.staging_m)

    def corridor(self, cell: int, sector: int, others: bool = True) -> Found:
        """One corridor, the objects on other cells too if `others`."""
        direction = float(self.reach.sectors_deg[sector])
        try:
            along, into, out = follow_corridor(self.kinematics, self._ready, self.layout.cells[cell], direction)
        except (Unreachable, ValueError) as error:
            return Found(str(error))
        check, touched = self._checker.first_contact, self._checker.touched
        contact = (
            check(along, self._all, reached_for=cell)
            or check(into, {cell: self._all[cell]}, reached_for=cell)
            or check(out, {}, held=Held(cell))
        )
        if contact is not None:
            return Found(f"the {contact.part} would touch the {contact.other}")
        rest = {other: standing for other, standing in self._all.items() if others and other != cell}
        return Found("", frozenset(touched(into, rest)), frozenset(touched(out, rest, held=Held(cell))))

    def survey(self, corridors: Iterable[tuple[int, int]]) -> Survey:
        """The corridors (cell, sector) measured; all others count as not followed."""
        n_cells, n_sectors = self.reach.n_cells, self.reach.n_sectors
        followed = torch.zeros(n_cells, n_sectors, dtype=torch.bool)
        empty, loaded = (torch.zeros(n_cells, n_sectors, n_cells, dtype=torch.bool) for _ in range(2))
        why_not = {}
        for cell, sector in corridors:
            found = self.corridor(cell, sector)
            followed[cell, sector], why_not[cell, sector] = not found.why_not, found.why_not
            empty[cell, sector, sorted(found.empty)] = True
            loaded[cell, sector, sorted(found.loaded)] = True
        return Survey(self.reach, followed, empty, loaded, why_not)


@dataclass(frozen=True)
class Survey:
    """All corridors of a layout.

    followed: Bool[G, S]; empty, loaded: Bool[G, S, G], the cells whose objects are touched; why_not: for each corridor
    that was measured, what hinders the arm.
    """

    reach: Reach
    followed: Tensor
    empty: Tensor
    loaded: Tensor
    why_not: dict[tuple[int, int], str]

    @property
    def touched(self) -> Tensor:
        """Bool[G, S, G]: by the empty hand, or by the loaded one."""
        return self.empty | self.loaded

    @property
    def blocking(self) -> Tensor:
        """Bool[G, S, G]: which cells the rule wants empty."""
        return unpack(self.reach.blockers, self.reach.n_cells)

    @property
    def not_blocked(self) -> Tensor:
        """Bool[G, S, G]: touched on an allowed corridor, though the rule lets an object stand there: a bug."""
        return self.touched & ~self.blocking & self.reach.allowed_sectors[..., None]

    def off_line_m(self) -> Tensor:
        """Float64[G, S, G]: how far a cell's middle is from a corridor's line: the clearance that just covers it.

        inf where it lies behind the line's end.
        """
        centre = self.reach.layout.centres
        x, y = (centre[None] - centre[:, None])[:, None].unbind(-1)
        heading = (torch.atan2(-centre[:, 1], -centre[:, 0])[:, None] + self.reach.sectors_deg.deg2rad())[..., None]
        along, across = x * heading.cos() + y * heading.sin(), y * heading.cos() - x * heading.sin()
        return torch.where(along >= -1e-9, across.abs(), torch.inf)

    def corridor_rows(self) -> pd.DataFrame:
        """A row a corridor that was measured; touched, blocked: on how many of the `others`, the other cells."""
        reach, blocked, touched = self.reach, self.blocking, self.touched
        at = cell, sector = tuple(torch.tensor(list(self.why_not)).T)
        columns = {
            "cell": cell + 1,
            "x_m": reach.layout.centres[cell, 0],
            "y_m": reach.layout.centres[cell, 1],
            "sector": sector,
            "direction_deg": reach.sectors_deg[sector],
            "allowed": reach.allowed_sectors[at].int(),
            "followed": self.followed[at].int(),
            "why_not": list(self.why_not.values()),
            "others": reach.n_cells - 1,
            "blocked": blocked[at].sum(-1),
            "touched": touched[at].sum(-1),
            "touched_not_blocked": (touched & ~blocked)[at].sum(-1),
        }
        return pd.DataFrame(columns).round({"x_m": 4, "y_m": 4, "direction_deg": 3})

    def object_rows(self) -> pd.DataFrame:
        """A row for each object near an allowed corridor, or in its way; off_mm: how far from its line."""
        off = self.off_line_m()
        near = (off < 2 * self.reach.clearance_m) & ~torch.eye(self.reach.n_cells, dtype=torch.bool)[:, None]
        at = (self.reach.allowed_sectors[..., None] & (near | self.blocking | self.touched)).nonzero(as_tuple=True)
        columns = {"cell": at[0] + 1, "sector": at[1], "other": at[2] + 1, "off_mm": 1e3 * off[at]}
        for name, which in (("blocked", self.blocking), ("empty", self.empty), ("loaded", self.loaded)):
            columns[name] = which[at].int()
        return pd.DataFrame(columns).round({"off_mm": 2})


def main(options: Options) -> int:
    """Measure and write; 1 where a corridor is allowed that the arm cannot follow, or on which it touches."""
    arm = preset(f"arm/{options.arm}", **OmegaConf.from_dotlist(options.arm_keys))
    layout = Layout.grid(options.rows, options.cols, options.cell_m, options.front_m)
    surveyor = Surveyor(arm, preset(f"objects/{options.objects}"), layout)
    started = time.process_time()
    every = torch.cartesian_prod(*map(torch.arange, surveyor.reach.allowed_sectors.shape)).tolist()
    found = surveyor.survey(every)
    about = {key: value for key, value in asdict(options).items() if key not in ("out", "arm_keys")} | {
        "seconds": round(time.process_time() - started),
        "distance_mm": round(1e3 * arm.clearance_m, 3),
        "half_hand_mm": round(1e3 * surveyor.kinematics.hand_half_width_m, 3),
        "clearance_mm": round(1e3 * found.reach.clearance_m, 3),
        "margin_mm": round(1e3 * arm.corridor_margin_m, 3),
    }
    write_measurements(options.out / "corridors", found.corridor_rows(), **about)
    write_measurements(options.out / "objects", found.object_rows(), **about)
    return int(bool((found.reach.allowed_sectors & ~found.followed).any() or found.not_blocked.any()))


if __name__ == "__main__":
    sys.exit(run(main, Options))
