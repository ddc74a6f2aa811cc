"""The boards that the network fails on though a plan is proved, and where each of its plans first loses ground.

python -m scripts.failures out=FOLDER [model=FILE] [columns=[8x8_z3-13,6x6_z3-8]] [boards=5000] [picture=FILE]
Boards are of the validation split, so that the test split stays unseen. FOLDER/rows.csv has a row a board, and the
picture the first failing ones; `dore-report study=failures` makes the page.
"""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from dore.app import build
from dore.errors import InputError, whole
from dore.learn.checkpoint import SHIPPED
from dore.learn.corridor_features import corridor_costs
from dore.planners.base import Planner
from dore.report.measurements import write_measurements
from dore.world.plan import Move, Plan, Status, replay
from dore.world.problem import Batch, Problem
from scripts.failures_figure import draw
from scripts.program import composed, run

PROOF_S = 10.0
"""A proof is given up after so many seconds of its own."""


@dataclass(frozen=True)
class Options:
    """out: the folder of the rows. model: a run directory or a model file. boards: of each column."""

    out: Path
    model: Path = SHIPPED
    columns: list[str] = field(default_factory=lambda: ["8x8_z3-13", "6x6_z3-8"])
    boards: int = 5000
    picture: Path = Path("docs/results/failures.png")

    def __post_init__(self) -> None:
        whole("boards", self.boards, 1)
        for name in self.columns:
            if not re.fullmatch(r"\d+x\d+_z\d+-\d+", name):
                raise InputError(f"columns: got {name!r}, want LAYOUT_INSTANCES, as 8x8_z3-13")


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
    ending: str = ""
    mistake: Mistake | None = None

    @property
    def row(self) -> dict[str, Any]:
        """For rows.csv."""
        names = ("column", "instance", "status", "optimum", "now", "ending")
        mistake = [getattr(self.mistake, name, None) for name in ("number", "now", "optimum", "after")]
        found = {name: getattr(self, name) for name in names} | {"status": str(self.status)}
        return found | dict(zip(("mistake", "mistake_now", "before", "after"), mistake, strict=True))


def main(options: Options) -> None:
    """Write the rows and the picture."""
    columns = [boards_of(name, options.model, options.boards) for name in options.columns]
    options.picture.parent.mkdir(parents=True, exist_ok=True)
    draw(options.picture, columns)
    rows = [board.row for boards in columns for board in boards]
    write_measurements(options.out, rows, weights=options.model.name, proof_s=PROOF_S)


def boards_of(name: str, model: Path, boards: int) -> list[Board]:
    """Plan a column's validation boards with the network and with the proof.

    Args:
        name: LAYOUT_INSTANCES, as 8x8_z3-13.
        boards: how many of them.

    Raises:
        InputError: no such model, or not so many boards.
    """
    layout, _, difficulty = name.partition("_")
    world = [f"layout={layout}", "reach=wide_hand", f"instances={difficulty}", f"instances.validation_size={boards}"]
    planners = ["planner=[learned,exact]", f"planners.exact.max_seconds={PROOF_S}", f"model={model}"]
    cfg = composed("evaluate", *world, *planners)
    reach = build.reach_of(cfg, "cpu")
    learned, exact = build.planners_of(cfg, reach)
    if getattr(getattr(learned, "agent", None), "encoding", None) != "lanes":
        raise InputError(f"model: {model} does not see the corridor costs, want one of agent.encoding=lanes")
    instances = build.splits_of(cfg, reach).validation(reach)
    batch = instances.batch()
    plans = zip(
        instances, exact.plan(batch), learned.plan(batch), corridor_costs(reach, *batch).now.tolist(), strict=True
    )
    found = []
    for number, (problem, proof, tried, now) in enumerate(plans, 1):
        board = Board(name, number, proof.status, proof.optimal_moves, now)
        if proof.status is Status.SOLVED and tried.status is not Status.SOLVED:
            board = replace(board, ending=tried.reason, mistake=mistake_of(problem, proof, tried, exact))
        found.append(board)
    return found


def mistake_of(problem: Problem, proof: Plan, tried: Plan, exact: Planner) -> Mistake | None:
    """The first mistake of the network's plan; None where it ends before one."""
    reach = problem.reach
    states = [
        Problem(replace(problem.scene, obstacles=tuple(sorted(board))), reach) for board in replay(problem, tried)
    ]
    for number, (before, move, after) in enumerate(zip(states, tried.moves, states[1:], strict=False), 1):
        (then,) = exact.plan(Batch.of(after))
        if then.optimal_moves != len(proof.moves) - 1:
            now = int(corridor_costs(reach, *Batch.of(before)).now)
            return Mistake(number, before, now, proof.moves[0], move, len(proof.moves), then.optimal_moves)
        proof = then
    return None


if __name__ == "__main__":
    sys.exit(run(main, Options))
