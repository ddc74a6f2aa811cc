"""The boards that the network fails on though a plan is proved, and where each of its plans first loses ground.

python -m scripts.failures out=FOLDER [model=FILE] [columns=[8x8_z3-13,6x6_z3-8]] [boards=5000] [picture=FILE]
Boards are of the validation split, so that the test split stays unseen. FOLDER/rows.csv has a row a board, and the
picture the first failing ones; `dore-report study=failures` makes the page.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from dore.app import build
from dore.draw.board_art import LEGEND, draw_legend
from dore.draw.boards import Panel, draw_panel, panels_of
from dore.draw.style import INK, save_figure
from dore.errors import InputError
from dore.learn.checkpoint import Q_NETWORK
from dore.learn.corridor_features import corridor_costs
from dore.planners.base import Planner
from dore.report.measurements import write_measurements
from dore.report.panels import panels
from dore.world.plan import Move, Plan, Status
from dore.world.problem import Batch, Problem
from scripts.program import composed, run

MOST = 6
"""Boards that are drawn."""
PROOF_S = 10.0
"""A proof is given up after so many seconds of its own."""


@dataclass(frozen=True)
class Options:
    """out: the folder of the rows. model: a run directory or a model file. boards: of each column."""

    out: Path
    model: Path = Q_NETWORK
    columns: list[str] = field(default_factory=lambda: ["8x8_z3-13", "6x6_z3-8"])
    boards: int = 5000
    picture: Path = Path("docs/results/failures.png")

    def __post_init__(self) -> None:
        for name in self.columns:
            if not re.fullmatch(r"\d+x\d+_z\d+-\d+", name):
                raise InputError(f"columns: got {name!r}, want LAYOUT_INSTANCES, as 8x8_z3-13")


@dataclass(frozen=True)
class Mistake:
    """The network's first move after which no plan of one move fewer is proved.

    number: the move's, from 1. panel: the board before it, and the move. now: the corridor cost of that board. best:
    the first move of a shortest plan from there. before, after: the fewest moves before and after the network's move;
    `after` is None where there is no plan, or no proof in time.
    """

    number: int
    panel: Panel
    now: int
    best: Move
    before: int
    after: int | None


class Board(NamedTuple):
    """A validation board: its row, and what the network's plan gets wrong there, if anything.

    Of the row: instance: the number in the set, from 1. status: of the proof. optimum: the proved fewest moves, None
    where there is no plan or no proof. now: the corridor cost. stop_reason: why the network's plan stops without the
    target, empty where it does not or where nothing is proved. mistake: the move's number; mistake_now, before, after:
    as of `Mistake`.
    """

    row: dict[str, Any]
    mistake: Mistake | None


def main(options: Options) -> None:
    """Write the rows and the picture."""
    columns = [boards_of(name, options.model, options.boards) for name in options.columns]
    options.picture.parent.mkdir(parents=True, exist_ok=True)
    draw(options.picture, columns)
    rows = [board.row for boards in columns for board in boards]
    write_measurements(options.out, rows, weights=options.model.name, proof_s=PROOF_S)


def boards_of(name: str, model: Path, boards: int) -> list[Board]:
    """So many validation boards of a column, planned by the network and by exact search.

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
        failed = proof.status is Status.SOLVED and tried.status is not Status.SOLVED
        mistake = mistake_of(problem, proof, tried, exact) if failed else None
        row = {"column": name, "instance": number, "status": proof.status.value, "optimum": proof.optimal_moves}
        row |= {"now": now, "stop_reason": tried.reason if failed else ""}
        of = {"mistake": "number", "mistake_now": "now", "before": "before", "after": "after"}
        found.append(Board(row | {column: getattr(mistake, key, None) for column, key in of.items()}, mistake))
    return found


def mistake_of(problem: Problem, proof: Plan, tried: Plan, exact: Planner) -> Mistake | None:
    """The first mistake of the network's plan; None where it stops before one."""
    for before, after in pairwise(panels_of(problem, tried)):
        (then,) = exact.plan(Batch.of(after.problem))
        if then.optimal_moves != len(proof.moves) - 1:
            now = int(corridor_costs(problem.reach, *Batch.of(before.problem)).now)
            return Mistake(before.number, before, now, proof.moves[0], len(proof.moves), then.optimal_moves)
        proof = then
    return None


def drawn_of(columns: Sequence[Sequence[Board]]) -> list[Board]:
    """The first failing boards of each column, `MOST` in all."""
    each = [[board for board in boards if board.mistake is not None] for boards in columns]
    return [board for failing in each for board in failing[: MOST // len(columns)]]


def draw(path: Path, columns: Sequence[Sequence[Board]]) -> None:
    """Write the PNG, two boards a failure, two failures a line; no file where nothing fails."""
    shown = [side for board in drawn_of(columns) for side in sides(board)]
    if not shown:
        path.unlink(missing_ok=True)
        return
    figure, places = panels(len(shown), 4, 3.4, 4.0)
    for axes, (title, panel) in zip(places, shown, strict=True):
        axes.set_title(title, fontsize=8.5, color=INK, pad=3)
        draw_panel(axes, panel)
    draw_legend(figure, tuple(LEGEND), columns=4, scale=1.2)
    save_figure(figure, path)


def sides(board: Board) -> list[tuple[str, Panel]]:
    """The titles and the boards of a failure: a shortest plan's move, the network's move."""
    row, mistake = board
    if mistake is None:
        return []
    move, best = mistake.panel, replace(mistake.panel, move=mistake.best)
    left = f"{mistake.after} left" if mistake.after is not None else "no plan proved"
    size, obstacles = row["column"].replace("x", " x ").split("_z")
    shortest = f"a shortest plan: {best.words}, {mistake.before - 1} left"
    networks = f"the network's move {mistake.number}: {move.words}, {left}"
    return [
        (f"{size}, {obstacles} obstacles, no. {row['instance']}\n{shortest}", best),
        (f"optimum {row['optimum']}, costs {row['now']}\n{networks}", move),
    ]


if __name__ == "__main__":
    sys.exit(run(main, Options))
