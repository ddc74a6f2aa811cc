"""How many boards of the test split a training stands on: the splits are of the boards that episodes start from.

    python -m tests.trust.overlap outputs/trust

overlap/rows.csv: a row a layout. Training instances, random legal moves, as a run with epsilon = 1 would make them.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import torch
from hydra import compose, initialize_config_dir
from torch import Tensor
from tqdm import tqdm

from dore.app import build
from dore.files import conf_dir
from dore.learn import keys
from dore.learn.env import RearrangeEnv, Rewards
from dore.report.measurements import write_measurements
from dore.world.generator import SPLITS, split_share
from dore.world.reach import Reach
from dore.world.rules import legal_places

WORLDS = (("3x6", "z3-7"), ("6x6", "z3-8"), ("8x8", "z3-13"))
ENVS = 1024


def boards_stood_on(reach: Reach, source: object, steps: int, seed: int) -> Iterator[tuple[Tensor, Tensor, Tensor]]:
    """(boards, targets, whether an episode starts there) of each step of random legal play; targets stay blocked."""
    env = RearrangeEnv(reach, source, ENVS, 16, Rewards(10.0, 0.0, -1.0))  # type: ignore[arg-type]
    generator = torch.Generator().manual_seed(seed)
    now, starts = env.reset(), torch.ones(ENVS, dtype=torch.bool)
    for _ in range(steps // ENVS):
        board, target, visited = now[keys.BOARD], now[keys.TARGET], now[keys.VISITED]
        yield board, target, starts
        pick = now[keys.LEGAL_PICK].float().multinomial(1, generator=generator).squeeze(-1)
        places = legal_places(reach, board, target, visited, pick)
        place = places.float().multinomial(1, generator=generator).squeeze(-1)
        stepped, now = env.step_and_maybe_reset(now.set(keys.PICK, pick).set(keys.PLACE, place))
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


def main() -> None:
    """The program."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    torch.set_num_threads(1)
    rows = [overlap(layout, instances, given.steps, given.seed) for layout, instances in WORLDS]
    write_measurements(given.folder / "overlap", rows, seed=given.seed)
    for row in rows:
        print(row)


if __name__ == "__main__":
    main()
