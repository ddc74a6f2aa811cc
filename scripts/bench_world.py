"""Times the accessibility check and the environment, each against what it must beat, in turn in one process.

python -m scripts.bench_world out=FOLDER
FOLDER/reach/rows.csv and FOLDER/env/rows.csv have a row a round and variant, the variants of a round in turn, so that a
machine's drift hits all alike; `dore-report study=world` makes the page.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from timeit import timeit
from typing import Any

import torch
from torch import Tensor

from dore.learn import keys
from dore.learn.env import RearrangeEnv, Rewards
from dore.report.measurements import write_measurements
from dore.world import board as boards
from dore.world.generator import Difficulty, FreshInstances
from dore.world.layout import Layout
from dore.world.reach import Reach
from dore.world.rules import legal_moves, legal_places, transition
from scripts.program import run

ROUNDS = 15
PRESETS = {"published": (0.106, 30.0, 60), "wide_hand": (0.142, 15.0, 30)}
BOARDS, ENVS = 8192, 4096
Rows = list[dict[str, Any]]


@dataclass(frozen=True)
class Options:
    """out: the folder of the rows."""

    out: Path


def main(options: Options) -> None:
    """Run the benchmarks and write their rows."""
    about = {"load_before": f"{os.getloadavg()[0]:.2f}", "rounds": ROUNDS, "threads": 1}
    write_measurements(options.out / "reach", reach_rows(), **about)
    write_measurements(options.out / "env", env_rows(), **about)


def reach_rows() -> Rows:
    """Seconds of `Reach.accessible` on `BOARDS` boards of 8 x 8, and of the obvious way to find the same.

    Raises:
        RuntimeError: they do not find the same.
    """
    occupied = torch.rand(BOARDS, 64, generator=torch.Generator().manual_seed(0)) < 0.2
    rows: Rows = []
    for preset, numbers in PRESETS.items():
        reach = Reach(Layout.grid(8, 8, 0.12), *numbers)
        fast, plain = torch.compile(reach.accessible, dynamic=False), plain_matmul(reach)
        if not torch.equal(plain(occupied), fast(occupied)):
            raise RuntimeError(f"{preset}: the kernels disagree")
        variants = {"matmul": plain, "eager": reach.accessible, "compiled": fast}
        rows += [{"preset": preset, **row} for row in in_turn(variants, occupied)]
    return rows


def plain_matmul(reach: Reach) -> Callable[[Tensor], Tensor]:
    """The obvious way: count the obstacles in every sector of every cell by one float matrix product."""
    cells, sectors = reach.n_cells, reach.n_sectors
    covers = boards.unpack(reach.blockers, cells).reshape(cells * sectors, cells).T.float().contiguous()
    return lambda occupied: ((occupied.float() @ covers).view(-1, cells, sectors) < 0.5).any(-1)


def in_turn(variants: Mapping[str, Callable[[Tensor], object]], given: Tensor) -> Rows:
    """A row a round and variant, after two rounds that do not count."""
    rows = [
        {"round": round_, "variant": name, "seconds": timeit(partial(variant, given), number=1)}
        for round_ in range(-2, ROUNDS)
        for name, variant in variants.items()
    ]
    return [row for row in rows if row["round"] >= 0]


def env_rows() -> Rows:
    """Seconds of a step of `ENVS` boards by the bare functions, by `EnvBase.step`, and with the reset of what ended.

    Half of the rounds do not count. Random legal actions on 8 x 8; choosing them is not counted.
    """
    reach = Reach(Layout.grid(8, 8, 0.12), *PRESETS["wide_hand"])
    source = FreshInstances(reach, Difficulty(3, 13), "train", seed=0)
    env = RearrangeEnv(reach, source, num_envs=ENVS, max_moves=16, rewards=Rewards(10.0, 0.0, -1.0))
    draw = partial(torch.multinomial, num_samples=1, generator=torch.Generator().manual_seed(0))
    observed, rows = env.reset(), []
    for round_ in range(-ROUNDS, ROUNDS):
        state = reach, observed[keys.BOARD], observed[keys.TARGET], observed[keys.VISITED]
        pick = draw(observed[keys.LEGAL_PICK].float()).squeeze(-1)
        place = draw(legal_places(*state, pick).float()).squeeze(-1)
        acted = observed.set(keys.PICK, pick).set(keys.PLACE, place)
        times = [time.perf_counter()]
        moved = transition(*state, pick, place)
        legal_moves(reach, moved.board, *state[2:])
        times.append(time.perf_counter())
        step = env.step(acted)
        times.append(time.perf_counter())
        observed = env.maybe_reset(env.step_mdp(step))
        times.append(time.perf_counter())
        if round_ >= 0:
            for name, first, last in (("bare", 0, 1), ("step", 1, 2), ("step and reset", 1, 3)):
                rows.append({"round": round_, "variant": name, "boards": ENVS, "seconds": times[last] - times[first]})
    return rows


if __name__ == "__main__":
    sys.exit(run(main, Options))
