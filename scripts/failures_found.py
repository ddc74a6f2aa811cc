"""Which boards the network fails on though a plan is proved, and where in its plan it first loses ground."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from dore.app import build
from dore.errors import InputError
from dore.learn.corridor_features import corridor_costs
from dore.planners.base import Planner
from dore.world.board import bit
from dore.world.instances import InstanceSet, problems_of
from dore.world.plan import Move, Plan, Status
from dore.world.problem import Batch, Problem
from dore.world.reach import Reach
from dore.world.rules import lift
from scripts.planner_timing import composed

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
    """A board that can be solved.

    instance: its number in the set, from 1. optimum: its proved fewest moves. now: what the lanes' costs say of it.
    ending: why the network's plan ends without the target, empty where it does not.
    """

    instance: int
    optimum: int
    now: int
    ending: str
    mistake: Mistake | None = None

    @property
    def above(self) -> bool:
        """Whether the lanes' costs promise more than there is."""
        return self.optimum > self.now


@dataclass(frozen=True)
class Column:
    """A layout and its numbers of obstacles.

    drawn: instances in all. undecided: those without a plan or a proof. boards: those that can be solved.
    """

    name: str
    reach: Reach
    drawn: int
    undecided: int
    boards: list[Board]

    @property
    def title(self) -> str:
        """`8 x 8, 3-13 obstacles`."""
        size, obstacles = self.name.split("_z")
        return f"{size.replace('x', ' x ')}, {obstacles} obstacles"

    @property
    def failed(self) -> list[Board]:
        """The boards that the network does not solve."""
        return [board for board in self.boards if board.ending]


def column_of(name: str, model: Path, boards: int) -> Column:
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
    cfg = composed([*overrides, *planners])
    reach = build.reach_of(cfg, "cpu")
    learned, exact = build.planners_of(cfg, reach)
    if getattr(getattr(learned, "agent", None), "encoding", None) != "lanes":
        raise InputError(f"--model: {model} does not see the corridor costs, want one of agent.encoding=lanes")
    instances = build.splits_of(cfg, reach).validation(reach)
    proofs, tries = exact.plan(instances.batch()), learned.plan(instances.batch())
    now = corridor_costs(reach, *instances.batch()).now.tolist()
    found = [
        Board(row + 1, len(proof.moves), now[row], "" if tried.status is Status.SOLVED else tried.reason)
        for row, (proof, tried) in enumerate(zip(proofs, tries, strict=True))
        if proof.status is Status.SOLVED
    ]
    lost = [board.instance - 1 for board in found if board.ending]
    mistakes = _mistakes(instances, exact, lost, [proofs[row] for row in lost], [tries[row] for row in lost])
    found = [replace(board, mistake=mistakes.get(board.instance - 1)) for board in found]
    undecided = sum(proof.status is Status.GAVE_UP for proof in proofs)
    return Column(name, reach, len(proofs), undecided, found)


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
