"""How many boards of the test split a training stands on: the splits are of the boards that episodes start from.

    python -m tests.trust.overlap out=outputs/trust

overlap/rows.csv: a row a layout. Training instances, random legal moves, as a run with epsilon = 1 would make them.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import torch
from hydra import compose, initialize_config_dir
from torch import Tensor
from tqdm import tqdm

from dore.app import build
from dore.files import conf_dir
from dore.learn import keys
from dore.learn.env import RearrangeEnv
from dore.report.measurements import write_measurements
from dore.world.generator import SPLITS, split_share
from dore.world.reach import Reach
from scripts.program import run
from tests.worlds import REWARDS, random_legal

WORLDS = (("3x6", "z3-7"), ("6x6", "z3-8"), ("8x8", "z3-13"))
ENVS = 1024


def boards_stood_on(reach: Reach, source: object, steps: int, seed: int) -> Iterator[tuple[Tensor, Tensor, Tensor]]:
    """(boards, targets, whether an episode starts there) of each step of random legal play; targets stay blocked."""
    env = RearrangeEnv(reach, source, ENVS, 16, REWARDS)  # type: ignore[arg-type]
    generator = torch.Generator().manual_seed(seed)
    now, starts = env.reset(), torch.ones(ENVS, dtype=torch.bool)
    for _ in range(steps // ENVS):
        yield now[keys.BOARD], now[keys.TARGET], starts
        stepped, now = env.step_and_maybe_reset(random_legal(env, now, generator))
        starts = stepped["next", keys.DONE].squeeze(-1)


def overlap(layout: str, instances: str, steps: int, seed: int) -> dict[str, object]:
    """The row of a layout."""
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        cfg = compose("evaluate", [f"layout={layout}", f"instances={instances}", "reach=wide_hand"])
    reach = build.reach_of(cfg, "cpu")
    splits = build.splits_of(cfg, reach)
    test = splits.test(reach)
    wanted = {(*row, at) for row, at in zip(test.board.tolist(), test.target.tolist(), strict=True)}
    low, high = SPLITS["test"]
    stood, in_test, starts_in_test, met = 0, 0, 0, set()
    play = boards_stood_on(reach, splits.train(reach, seed), steps, seed)
    for board, target, starts in tqdm(play, total=steps // ENVS, desc=layout, mininterval=5.0):
        share = split_share(board, reach)
        of_test = (share >= low) & (share < high)
        stood += len(board)
        in_test += int(of_test.sum())
        starts_in_test += int((of_test & starts).sum())
        some = of_test.nonzero().squeeze(-1)
        met |= wanted & {(*row, at) for row, at in zip(board[some].tolist(), target[some].tolist(), strict=True)}
    return {
        "layout": layout,
        "instances": instances,
        "steps": stood,
        "starts_in_test": starts_in_test,
        "in_test": in_test,
        "test_instances": len(test),
        "met": len(met),
    }


@dataclass(frozen=True)
class Options:
    """out: the folder of the rows; steps: how many, in each layout."""

    out: Path
    steps: int = 1_000_000
    seed: int = 0


def main(options: Options) -> None:
    """Measure every layout and write the rows."""
    rows = [overlap(layout, instances, options.steps, options.seed) for layout, instances in WORLDS]
    write_measurements(options.out / "overlap", rows, seed=options.seed)
    for row in rows:
        print(row)


if __name__ == "__main__":
    sys.exit(run(main, Options))
