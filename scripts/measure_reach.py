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

import math
import sys
import time
from collections.abc import Collection, Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import NamedTuple

import pandas as pd
import torch
from omegaconf import OmegaConf

from dore.report.measurements import write_measurements
from dore.sim.config import ArmConfig, ObjectConfig, preset
from dore.sim.frames import TABLE_OVERHANG_M, turned
from dore.sim.kinematics import ArmKinematics, Unreachable
from dore.sim.motion.arm_reach import arm_reach, follow_corridor
from dore.sim.motion.collision import CollisionChecker, Held, Standing
from dore.sim.urdf import arm_files
from dore.world.board import unpack
from dore.world.layout import Layout
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

    why_not: str
    empty: Collection[int] = ()
    loaded: Collection[int] = ()


class Survey(NamedTuple):
    """What was measured. corridors: a row each. objects: a row for each other cell of each corridor.

    blocked, touched, touched_not_blocked: on how many of the `others`, the other cells.
    off_mm: how far the other cell's middle is from the corridor's line; inf where it lies behind the line's end.
    """

    corridors: pd.DataFrame
    objects: pd.DataFrame

    @property
    def faults(self) -> pd.DataFrame:
        """Allowed corridors that the arm cannot follow, or on which it touches what the rule lets stand there."""
        wrong = (self.corridors.followed == 0) | (self.corridors.touched_not_blocked > 0)
        return self.corridors[(self.corridors.allowed == 1) & wrong]


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
        return Found("", touched(into, rest), touched(out, rest, held=Held(cell)))

    def survey(self, corridors: Iterable[tuple[int, int]]) -> Survey:
        """Measure corridors: (cell, sector) each."""
        reach, rows, objects = self.reach, [], []
        blocking = unpack(reach.blockers, reach.n_cells)
        for cell, sector in corridors:
            found, (x, y), direction = self.corridor(cell, sector), self.layout.cells[cell], reach.sectors_deg[sector]
            here = {"cell": cell + 1, "sector": sector, "allowed": int(reach.allowed_sectors[cell, sector])}
            beside = [
                here
                | {"other": other + 1, "off_mm": self.off_line_mm(cell, sector, other)}
                | {"blocked": int(blocking[cell, sector, other])}
                | {"empty": int(other in found.empty), "loaded": int(other in found.loaded)}
                for other in range(reach.n_cells)
                if other != cell
            ]
            touched = [one for one in beside if one["empty"] or one["loaded"]]
            row = {"cell": cell + 1, "x_m": round(x, 4), "y_m": round(y, 4), "sector": sector}
            row |= {"direction_deg": round(float(direction), 3), "allowed": here["allowed"]}
            row |= {"followed": int(not found.why_not), "why_not": found.why_not, "others": len(beside)}
            row |= {"blocked": sum(one["blocked"] for one in beside), "touched": len(touched)}
            rows.append(row | {"touched_not_blocked": sum(not one["blocked"] for one in touched)})
            objects += beside
        return Survey(pd.DataFrame(rows), pd.DataFrame(objects))

    def off_line_mm(self, cell: int, sector: int, other: int) -> float:
        """How far a cell's middle is from a corridor's line: the clearance that just covers it."""
        here, there = self.layout.places[[cell, other]]
        heading = math.atan2(-here[1], -here[0]) + math.radians(float(self.reach.sectors_deg[sector]))
        along, across = turned(there - here, -heading)
        return 1e3 * abs(across) if along >= -1e-9 else math.inf


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
        "clearance_mm": round(1e3 * surveyor.reach.clearance_m, 3),
        "margin_mm": round(1e3 * arm.corridor_margin_m, 3),
    }
    objects = found.objects
    near = objects.off_mm < 2 * about["clearance_mm"]
    shown = (objects.allowed == 1) & (near | (objects[["blocked", "empty", "loaded"]] > 0).any(axis=1))
    write_measurements(options.out / "corridors", found.corridors, **about)
    write_measurements(options.out / "objects", objects[shown].drop(columns="allowed").round({"off_mm": 2}), **about)
    return int(len(found.faults) > 0)


if __name__ == "__main__":
    sys.exit(run(main, Options))
