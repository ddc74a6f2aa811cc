"""What a literal run has done so far, as docs/results/literal/NAME.csv and NAME.json (scripts/literal.sh calls this).

python -m scripts.literal_rows run=FOLDER out=docs/results/literal/NAME
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from dore.app.run_folder import read_config
from dore.files import ABOUT_FILE, METRICS_FILE, atomic_write, read_done, read_record
from dore.report.rows import read_table
from scripts.program import run

MOST_ROWS = 1100
"""Tests of a run in its CSV file, evenly spaced; the last one always."""


@dataclass(frozen=True)
class Options:
    """run: the run's folder. out: the files' path, without .csv and .json."""

    run: Path
    out: Path


def main(options: Options) -> None:
    """Write both files."""
    about, tests = run_of(options.run)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(f"{options.out}.csv") as file:
        tests.to_csv(file, index=False, lineterminator="\n")
    with atomic_write(f"{options.out}.json") as file:
        file.write(json.dumps(about, indent=2) + "\n")


def run_of(folder: Path) -> tuple[dict[str, Any], pd.DataFrame]:
    """What a run is, and its tests (IPTs).

    t_lim: episodes. t_lim_updates: updates in these, an estimate where each step is followed by one. copy_every:
    updates between two copies of the targets. reading: what the run changes of the paper's preset. stop_reason: null
    while it runs.

    Raises:
        InputError: no run folder, or a damaged one.
    """
    cfg = read_config(folder, ("agent", "layout", "instances", "training", "target_update", "seed"))
    tests = read_table(folder / METRICS_FILE, ("episodes", "updates", "success", "loss", "epsilon"), text=())
    tests = tests[tests.success.notna()].astype({"episodes": int, "updates": int})
    every, t_lim = cfg.target_update.value_network_update_interval + 1, cfg.training.max_episodes
    a_step = cfg.training.update_after == "step" and len(tests)
    ratio = tests.updates.iloc[-1] / tests.episodes.iloc[-1] if a_step else cfg.training.updates
    rows = pd.DataFrame(
        {
            "episodes": tests.episodes,
            "updates": tests.updates,
            "share_of_episodes": (tests.episodes / t_lim).round(6),
            "share_of_updates": (tests.updates / (t_lim * ratio)).round(6),
            "ipt": (100 * tests.success).round(3),
            "loss": tests.loss.round(5),
            "epsilon": tests.epsilon.round(4),
            "target_copies": tests.updates // every,
        }
    )
    thin = -(-t_lim // cfg.ipt.every_episodes // MOST_ROWS)
    kept = pd.concat([rows.iloc[thin - 1 :: thin], rows.tail(1)]).drop_duplicates()
    structure = "single" if cfg.agent._target_.endswith(".Single") else "sequential"
    column = f"{cfg.layout.rows}x{cfg.layout.cols}_z{cfg.instances.min_obstacles}-{cfg.instances.max_obstacles}"
    reading = folder.name.removeprefix(f"{structure}_{column}").removesuffix(f"seed{cfg.seed}").strip("_")
    found = {"name": folder.name, "structure": structure, "column": column, "seed": cfg.seed, "reading": reading}
    found |= {"t_lim": t_lim, "t_lim_updates": round(t_lim * ratio), "copy_every": every}
    commit, stop_reason = read_record(folder / ABOUT_FILE).get("commit"), read_done(folder).get("stop_reason")
    return found | {"commit": commit, "stop_reason": stop_reason}, kept


if __name__ == "__main__":
    sys.exit(run(main, Options))
