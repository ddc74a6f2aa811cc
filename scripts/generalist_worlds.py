"""The evaluations behind the generalist's page, and which of their worlds the network has learned from."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from pathlib import Path

import hydra
import torch
from omegaconf import DictConfig

from dore.app import build
from dore.app.run_folder import read_config
from dore.configure import make
from dore.errors import InputError
from dore.files import conf_dir
from dore.report.evaluation import ROWS, Row, read_rows
from dore.report.frame import read_json
from dore.world.board import pack
from dore.world.instances import InstanceSplits
from dore.world.plan import Status
from dore.world.reach import Reach
from dore.world.rules import retrievable

SIZED = "wide_hand"
"""The reach that all sizes and densities are measured with."""
USUAL_CELL_M = 0.12
PLANNERS = ("learned", "guided")
SAME = ("layout", "reach", "instances", "split", "limit")
"""What decides on which instances planners are run."""
FREE_BOARDS = 20_000
"""Random boards for the share that needs no rearranging."""


class Known(StrEnum):
    """What the network has learned from."""

    TRAINED = "learned from"
    SIZE = "its reach, but never this size or density"
    REACH = "never this reach"


@dataclass(frozen=True)
class World:
    """One reach, layout and number of obstacles, and what each planner did there.

    reach: the preset's name. percent: density of the obstacles. rows: of `exact` and of `PLANNERS`, one an instance.
    """

    reach: str
    percent: int
    cfg: DictConfig
    known: Known
    rows: dict[str, list[Row]]

    @property
    def size(self) -> str:
        """`8 x 8`, and the edge of its cells where it is not the usual one."""
        layout = self.cfg.layout
        usual = layout.cell_m == USUAL_CELL_M
        return f"{layout.rows} x {layout.cols}" + ("" if usual else f", {100 * layout.cell_m:g} cm")

    @property
    def n_cells(self) -> int:
        """G."""
        return int(self.cfg.layout.rows * self.cfg.layout.cols)

    @property
    def n_obstacles(self) -> int:
        """Of each instance."""
        return int(self.cfg.instances.max_obstacles)

    @cached_property
    def solvable(self) -> set[int]:
        """Instances that some planner solves."""
        return {row.instance for rows in self.rows.values() for row in rows if row.status is Status.SOLVED}

    @cached_property
    def undecided(self) -> set[int]:
        """Instances that no planner solves or proves to have no plan."""
        every = [row for rows in self.rows.values() for row in rows]
        return {row.instance for row in every} - {row.instance for row in every if row.status is not Status.GAVE_UP}

    @cached_property
    def free(self) -> float:
        """Share of random boards whose target is accessible at once, and which are no instances."""
        reach, generator = build.reach_of(self.cfg, "cpu"), torch.Generator().manual_seed(0)
        cells = torch.rand(FREE_BOARDS, reach.n_cells, generator=generator).topk(self.n_obstacles + 1).indices
        occupied = torch.zeros(FREE_BOARDS, reach.n_cells, dtype=torch.bool).scatter_(1, cells[:, 1:], True)
        return float(retrievable(reach, pack(occupied), cells[:, 0]).float().mean())

    def solved(self, planner: str) -> int:
        """How many instances a planner solves."""
        return sum(row.status is Status.SOLVED for row in self.rows[planner])


@dataclass(frozen=True)
class Evaluations:
    """All worlds that are evaluated, and what made the evaluations."""

    worlds: list[World]
    commits: list[str]
    torch: list[str]
    model: str

    @property
    def sized(self) -> list[World]:
        """Every size and density, of one reach."""
        return [world for world in self.worlds if world.reach == SIZED]

    @property
    def others(self) -> list[World]:
        """The other reaches, one after the other."""
        return sorted((world for world in self.worlds if world.reach != SIZED), key=lambda world: world.reach)


def read_evaluations(folder: Path, trained: Sequence[str]) -> Evaluations:
    """Read `folder`/REACH/SIZE_PERCENT/{exact,model}, smaller boards first.

    Args:
        trained: the overrides of each world that the network has learned from.

    Raises:
        InputError: nothing is evaluated, two evaluations of a world with different instances, or a damaged file.
    """
    from_these = [(build.reach_of(cfg, "cpu"), make(cfg.instances, "instances")) for cfg in map(_train, trained)]
    worlds = []
    for path in sorted(folder.glob(f"*/*/model/{ROWS}")):
        exact, model = path.parents[1] / "exact", path.parent
        if not (exact / ROWS).exists():
            continue
        cfg, other = read_config(model, SAME), read_config(exact, SAME)
        if differ := [key for key in SAME if cfg[key] != other[key]]:
            raise InputError(f"{model}: {', '.join(differ)} not as in {exact}, want the same instances")
        rows: dict[str, list[Row]] = {"exact": read_rows(exact / ROWS)}
        for row in read_rows(path):
            rows.setdefault(row.planner, []).append(row)
        if missing := [name for name in PLANNERS if name not in rows]:
            raise InputError(f"{path}: no rows of {', '.join(missing)}")
        percent = re.fullmatch(r".+_(\d+)", path.parents[1].name)
        if percent is None:
            raise InputError(f"{path.parents[1]}: want a folder called SIZE_PERCENT, as 8x8_20")
        worlds.append(World(path.parents[2].name, int(percent[1]), cfg, _known(cfg, from_these), rows))
    if not worlds:
        raise InputError(f"{folder}: nothing is evaluated, want REACH/SIZE_PERCENT with exact and model")
    worlds.sort(key=lambda world: (world.n_cells, world.size, world.percent))
    models = sorted({str(world.cfg.model) for world in worlds})
    if len(models) > 1:
        raise InputError(f"{folder}: evaluated with {' and '.join(models)}, want one model")
    abouts = [read_json(path) for path in sorted(folder.glob("**/about.json"))]
    return Evaluations(
        worlds,
        commits=sorted({str(about["commit"]) for about in abouts}),
        torch=sorted({about["versions"]["torch"] for about in abouts}),
        model=models[0],
    )


def _train(overrides: str) -> DictConfig:
    """The config of a training world."""
    with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
        return hydra.compose("train", overrides.split())


def _known(cfg: DictConfig, trained: Sequence[tuple[Reach, InstanceSplits]]) -> Known:
    """How much of a world the network has learned from."""
    reach, obstacles = build.reach_of(cfg, "cpu"), cfg.instances.max_obstacles
    of_reach = [(one, splits) for one, splits in trained if one.to_dict() == reach.to_dict()]
    for one, splits in of_reach:
        if one.layout == reach.layout and splits.min_obstacles <= obstacles <= splits.max_obstacles:
            return Known.TRAINED
    return Known.SIZE if of_reach else Known.REACH
