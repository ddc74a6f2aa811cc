"""The boards that the network fails on though a plan is proved, and where each of its plans first loses ground.

python -m scripts.failures OUT [--model FILE] [--columns 8x8_z3-13 6x6_z3-8] [--boards 5000] [--picture FILE]
Boards are of the validation split, so that the test split stays unseen. OUT/rows.csv has a row a board, and the picture
the first failing ones; `dore-report study=failures` makes the page.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from hydra.errors import HydraException

from dore.app import build
from dore.errors import InputError, whole
from dore.learn.checkpoint import SHIPPED
from dore.learn.corridor_features import corridor_costs
from dore.planners.base import Planner
from dore.report.measurements import write_measurements
from dore.world.board import bit
from dore.world.instances import InstanceSet, problems_of
from dore.world.plan import Move, Plan, Status
from dore.world.problem import Batch, Problem
from dore.world.rules import lift
from scripts.failures_figure import draw
from scripts.program import composed

PROOF_S = 10.0
"""A proof is given up after so many seconds of its own."""


@dataclass(frozen=True)
class Mistake:
    """The network's first move after which no plan of one move fewer is proved.

    number: the move's, from 1. problem: the board before it. now: the corridor cost of that board.
    best: the first move of a shortest plan from there. optimum, after: the fewest moves before and after the
    network's move; `after` is None where there is no plan, or no proof in time.
    """

    number: int
    problem: Problem
    now: int
    best: Move
    move: Move
    optimum: int
    after: int | None


@dataclass(frozen=True)
class Board:
    """A validation board.

    column: LAYOUT_INSTANCES. instance: its number in the set, from 1. status: of the proof. optimum: its proved fewest
    moves, None where there is no plan or no proof. now: the corridor cost of it. ending: why the network's plan ends
    without the target, empty where it does not or where nothing is proved.
    """

    column: str
    instance: int
    status: Status
    optimum: int | None
    now: int
    ending: str
    mistake: Mistake | None = None

    @property
    def row(self) -> dict[str, Any]:
        """For rows.csv."""
        names = ("column", "instance", "status", "optimum", "now", "ending")
        mistake = [getattr(self.mistake, name, None) for name in ("number", "now", "optimum", "after")]
        found = {name: getattr(self, name) for name in names} | {"status": str(self.status)}
        return found | dict(zip(("mistake", "mistake_now", "before", "after"), mistake, strict=True))


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the rows and the picture; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of the rows")
    parser.add_argument("--model", type=Path, default=SHIPPED, help="a run directory or a model file")
    parser.add_argument("--columns", nargs="+", default=("8x8_z3-13", "6x6_z3-8"), help="LAYOUT_INSTANCES")
    parser.add_argument("--boards", type=int, default=5000, help="of each column")
    parser.add_argument("--picture", type=Path, default=Path("docs/results/failures.png"))
    chosen = parser.parse_args(arguments)
    torch.set_num_threads(1)
    try:
        whole("--boards", chosen.boards, 1)
        columns = [boards_of(name, chosen.model, chosen.boards) for name in chosen.columns]
    except (InputError, HydraException) as error:
        print(f"failures: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    chosen.picture.parent.mkdir(parents=True, exist_ok=True)
    draw(chosen.picture, columns)
    rows = [board.row for boards in columns for board in boards]
    write_measurements(chosen.out, rows, weights=chosen.model.name, proof_s=PROOF_S)
    return 0


def boards_of(name: str, model: Path, boards: int) -> list[Board]:
    """Plan a column's validation boards with the network and with the proof.

    Args:
        name: LAYOUT_INSTANCES, as 8x8_z3-13.
        boards: how many of them.

    Raises:
        InputError: no such column, no such model, or not so many boards.
    """
    layout, _, difficulty = name.partition("_")
    if not re.fullmatch(r"\d+x\d+_z\d+-\d+", name):
        raise InputError(f"--columns: got {name!r}, want LAYOUT_INSTANCES, as 8x8_z3-13")
    overrides = [f"layout={layout}", f"instances={difficulty}", f"instances.validation_size={boards}"]
    planners = ["reach=wide_hand", "planner=[learned,exact]", f"planners.exact.max_seconds={PROOF_S}", f"model={model}"]
    cfg = composed("evaluate", *overrides, *planners)
    reach = build.reach_of(cfg, "cpu")
    learned, exact = build.planners_of(cfg, reach)
    if getattr(getattr(learned, "agent", None), "encoding", None) != "lanes":
        raise InputError(f"--model: {model} does not see the corridor costs, want one of agent.encoding=lanes")
    instances = build.splits_of(cfg, reach).validation(reach)
    proofs, tries = exact.plan(instances.batch()), learned.plan(instances.batch())
    now = corridor_costs(reach, *instances.batch()).now.tolist()
    found = []
    for row, (proof, tried) in enumerate(zip(proofs, tries, strict=True)):
        solved = proof.status is Status.SOLVED
        ending = tried.reason if solved and tried.status is not Status.SOLVED else ""
        found.append(Board(name, row + 1, proof.status, len(proof.moves) if solved else None, now[row], ending))
    lost = [row for row, board in enumerate(found) if board.ending]
    mistakes = _mistakes(instances, exact, lost, [proofs[row] for row in lost], [tries[row] for row in lost])
    return [replace(board, mistake=mistakes.get(row)) for row, board in enumerate(found)]


def _mistakes(
    instances: InstanceSet, exact: Planner, rows: list[int], proofs: list[Plan], tries: list[Plan]
) -> dict[int, Mistake]:
    """The first mistake of each of these rows, found move by move; a row whose plan ends before one has none."""
    found: dict[int, Mistake] = {}
    reach, going = instances.reach, list(zip(rows, proofs, tries, strict=True))
    board, target = instances.batch(torch.tensor(rows, dtype=torch.int64))
    number = 0
    while going:
        kept = [place for place, (_, _, tried) in enumerate(going) if len(tried.moves) > number]
        going, board, target = [going[place] for place in kept], board[kept], target[kept]
        if not going:
            break
        moves = [tried.moves[number] for _, _, tried in going]
        pick, place = (torch.tensor([getattr(move, end) for move in moves]) for end in ("pick", "place"))
        following = lift(board, pick) | bit(place, board.shape[-1])
        after = exact.plan(Batch(following, target))
        problems, now = problems_of(reach, Batch(board, target)), corridor_costs(reach, board, target).now.tolist()
        number += 1
        kept = []
        for index, ((row, proof, _), then) in enumerate(zip(going, after, strict=True)):
            fewest = len(then.moves) if then.status is Status.SOLVED else None
            if fewest == len(proof.moves) - 1:
                kept.append(index)
            else:
                found[row] = Mistake(
                    number, problems[index], now[index], proof.moves[0], moves[index], len(proof.moves), fewest
                )
        going = [(going[index][0], after[index], going[index][2]) for index in kept]
        board, target = following[kept], target[kept]
    return found


if __name__ == "__main__":
    sys.exit(main())
