"""Measures that look at the boards themselves, not at what planners did on them."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import torch
import yaml

from dore.configure import make, renamed
from dore.files import CONFIG_FILE
from dore.report.estimates import Estimate
from dore.world.board import pack
from dore.world.rules import retrievable

SAMPLE = 20_000


def accessible_at_once(rows: pd.DataFrame) -> Estimate:
    """The percentage of random boards of these rows' world whose target is accessible; such boards are no instances."""
    config = renamed(yaml.safe_load((Path(rows.folder.iloc[0]) / CONFIG_FILE).read_text(encoding="utf-8")))
    reach = make(config["reach"], "reach", layout=make(config["layout"], "layout"))
    generator = torch.Generator().manual_seed(0)
    n_obstacles = int(config["instances"]["max_obstacles"])
    cells = torch.rand(SAMPLE, reach.n_cells, generator=generator).topk(n_obstacles + 1).indices
    occupied = torch.zeros(SAMPLE, reach.n_cells, dtype=torch.bool).scatter_(1, cells[:, 1:], True)
    return Estimate(SAMPLE, 100 * float(retrievable(reach, pack(occupied), cells[:, 0]).float().mean()))
