"""What the arm can follow, corridor by corridor, against what its reach lets the planners ask for.

Every (cell, sector): there and back by inverse kinematics on the arm's branch, empty at grasp height and loaded above
it, without touching the table, itself or the object in the cell, nor anything on the way along the staging line.
Every (cell, sector, other cell): whether an object there is touched by the empty hand going in, or by the arm with an
object coming out. All objects are cans as wide as the widest that is ever drawn, however it is turned.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import torch
from omegaconf import OmegaConf
from torch import Tensor

from dore.report.measurements import write_measurements
from dore.sim.config import ArmConfig, ObjectConfig, preset
from dore.sim.motion.arm_reach import arm_reach, follow_corridor
from dore.sim.motion.collision import TABLE_OVERHANG_M, CollisionChecker, Contact, Held, Standing
from dore.sim.motion.frames import Array
from dore.sim.motion.kinematics import ArmKinematics, Unreachable
from dore.sim.scene.urdf import arm_files
from dore.world.board import unpack
from dore.world.layout import Layout
from dore.world.reach import Reach


@dataclass(frozen=True)
class Found:
    """One corridor. why: what hinders the arm, empty where it follows.

    empty, loaded: the cells whose objects it touches going in, and coming out; none are looked for where it does not
    follow.
    """

    why: str
    empty: frozenset[int] = frozenset()
    loaded: frozenset[int] = frozenset()

    @property
    def followed(self) -> bool:
        """The arm follows the corridor when nothing else stands on the table."""
        return not self.why


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
        contact = self._alone(cell, along, into, out)
        if contact is not None:
            return Found(f"the {contact.part} would touch the {contact.other}")
        if not others:
            return Found("")
        rest = {other: standing for other, standing in self._all.items() if other != cell}
        return Found(
            "",
            empty=frozenset(self._checker.touched(into, rest)),
            loaded=frozenset(self._checker.touched(out, rest, held=Held(cell))),
        )

    def _alone(self, cell: int, along: Array, into: Array, out: Array) -> Contact | None:
        check = self._checker.first_contact
        return (
            check(along, self._all, reached_for=cell)
            or check(into, {cell: self._all[cell]}, reached_for=cell)
            or check(out, {}, held=Held(cell))
        )


@dataclass(frozen=True)
class Survey:
    """All corridors of a layout.

    followed: Bool[G, S]; empty, loaded: Bool[G, S, G], the cells whose objects are touched; why: per corridor, what
    hinders the arm.
    """

    reach: Reach
    followed: Tensor
    empty: Tensor
    loaded: Tensor
    why: dict[tuple[int, int], str]

    @property
    def touched(self) -> Tensor:
        """Bool[G, S, G]: by the empty hand, or by the loaded one."""
        return self.empty | self.loaded

    @property
    def blocking(self) -> Tensor:
        """Bool[G, S, G]: which cells the rule wants empty."""
        return unpack(self.reach.blockers, self.reach.n_cells)

    @property
    def not_followed(self) -> Tensor:
        """Bool[G, S]: allowed, and yet the arm cannot; each one is a bug."""
        return self.reach.allowed_sectors & ~self.followed

    @property
    def not_blocked(self) -> Tensor:
        """Bool[G, S, G]: touched on an allowed corridor, though the rule lets an object stand there: a bug."""
        return self.touched & ~self.blocking & self.reach.allowed_sectors[..., None]

    def corridors(self) -> pd.DataFrame:
        """A row a corridor that was measured; touched, blocked: on how many of the `others`, the other cells."""
        reach, counts = self.reach, {"blocked": self.blocking, "touched": self.touched}
        counts["touched_not_blocked"] = self.touched & ~self.blocking
        rows = []
        for (cell, sector), why in self.why.items():
            x, y = reach.layout.cells[cell]
            row = {"cell": cell + 1, "x_m": round(x, 4), "y_m": round(y, 4), "sector": sector}
            row["direction_deg"] = round(float(reach.sectors_deg[sector]), 3)
            row |= {"allowed": int(reach.allowed_sectors[cell, sector]), "followed": int(not why), "why_not": why}
            rows.append(
                row | {"others": reach.n_cells - 1} | {n: int(w[cell, sector].sum()) for n, w in counts.items()}
            )
        return pd.DataFrame(rows)

    def off_line_m(self) -> Tensor:
        """Float64[G, S, G]: how far a cell's middle is from a corridor's line: the clearance that just covers it.

        inf where it lies behind the line's end.
        """
        centre = self.reach.layout.centres
        offset = centre[None] - centre[:, None]
        corridor = torch.atan2(-centre[:, 1], -centre[:, 0])[:, None] + self.reach.sectors_deg.deg2rad()
        along = offset[:, None, :, 0] * corridor.cos()[..., None] + offset[:, None, :, 1] * corridor.sin()[..., None]
        across = offset[:, None, :, 1] * corridor.cos()[..., None] - offset[:, None, :, 0] * corridor.sin()[..., None]
        return torch.where(along >= -1e-9, across.abs(), torch.inf)


def survey(surveyor: Surveyor, corridors: Iterable[tuple[int, int]]) -> Survey:
    """The corridors (cell, sector) measured; all others count as not followed."""
    reach, n_cells = surveyor.reach, surveyor.reach.n_cells
    followed = torch.zeros(n_cells, reach.n_sectors, dtype=torch.bool)
    empty, loaded = (torch.zeros(n_cells, reach.n_sectors, n_cells, dtype=torch.bool) for _ in range(2))
    why = {}
    for cell, sector in corridors:
        found = surveyor.corridor(cell, sector)
        followed[cell, sector], why[cell, sector] = found.followed, found.why
        empty[cell, sector, sorted(found.empty)] = True
        loaded[cell, sector, sorted(found.loaded)] = True
    return Survey(reach, followed, empty, loaded, why)


def write(folder: Path, found: Survey, about: Mapping[str, object]) -> None:
    """Write the measurements `corridors`, a row a corridor, and `objects`, a row for each object near one."""
    allowed = found.reach.allowed_sectors
    corridors, off_mm, near_mm = found.corridors(), 1e3 * found.off_line_m(), 2e3 * found.reach.clearance_m
    near = (off_mm < near_mm) & ~torch.eye(found.reach.n_cells, dtype=torch.bool)[:, None]
    cell, sector, other = (allowed[..., None] & (near | found.blocking | found.touched)).nonzero(as_tuple=True)
    at = (cell, sector, other)
    objects = pd.DataFrame({"cell": cell + 1, "sector": sector, "other": other + 1, "off_mm": off_mm[at].numpy()})
    for name, which in (("blocked", found.blocking), ("empty", found.empty), ("loaded", found.loaded)):
        objects[name] = which[at].int().numpy()
    for name, rows in (("corridors", corridors), ("objects", objects.round({"off_mm": 2}))):
        write_measurements(folder / name, rows, **about)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and write; 1 where a corridor is allowed that the arm cannot follow, or on which it touches."""
    chosen = _parser().parse_args(arguments)
    arm = preset(f"arm/{chosen.arm}", **OmegaConf.from_dotlist(chosen.set))
    layout = Layout.grid(chosen.rows, chosen.cols, chosen.cell_m, chosen.front_m)
    surveyor = Surveyor(arm, preset(f"objects/{chosen.objects}"), layout)
    started = time.process_time()
    every = torch.cartesian_prod(*map(torch.arange, surveyor.reach.allowed_sectors.shape)).tolist()
    found = survey(surveyor, every)
    about = {key: getattr(chosen, key) for key in ("arm", "objects", "rows", "cols", "cell_m", "front_m")} | {
        "seconds": round(time.process_time() - started),
        "distance_mm": round(1e3 * arm.clearance_m, 3),
        "half_hand_mm": round(1e3 * surveyor.kinematics.hand_half_width_m, 3),
        "clearance_mm": round(1e3 * found.reach.clearance_m, 3),
        "margin_mm": round(1e3 * arm.corridor_margin_m, 3),
    }
    write(chosen.folder, found, about)
    return int(bool(found.not_followed.any() or found.not_blocked.any()))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="where the tables go")
    parser.add_argument("--arm", default="panda_slim")
    parser.add_argument("--objects", default="mixed")
    parser.add_argument("--rows", type=int, default=3)
    parser.add_argument("--cols", type=int, default=6)
    parser.add_argument("--cell-m", type=float, default=0.12)
    parser.add_argument("--front-m", type=float, default=0.5)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="of the arm: urdf=PATH, ...")
    return parser


if __name__ == "__main__":
    sys.exit(main())
