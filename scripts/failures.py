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
from itertools import pairwise, zip_longest
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from dore.app import build
from dore.draw.board_art import CELL_INCH, LEGEND, draw_legend
from dore.draw.boards import Panel, draw_panel, panels_of
from dore.draw.style import INK, save_figure
from dore.errors import InputError
from dore.learn.checkpoint import Q_NETWORK
from dore.learn.corridor_features import corridor_costs
from dore.planners.base import Planner
from dore.report.measurements import write_measurements
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

    panel: the board before it, and the move. now: the corridor cost of that board. best: the first move of a shortest
    plan from there. before, after: the fewest moves before and after the network's move; `after` is None where there is
    no plan, or no proof in time.
    """

    panel: Panel
    now: int
    best: Move
    before: int
    after: int | None

    @property
    def number(self) -> int:
        """The move's, from 1."""
        return self.panel.number


@dataclass(frozen=True)
class Board:
    """A validation board.

    column: LAYOUT_INSTANCES. instance: its number in the set, from 1. status: of the proof. optimum: its proved fewest
    moves, None where there is no plan or no proof. now: the corridor cost of it. stop_reason: why the network's
    plan stops without the target, empty where it does not or where nothing is proved.
    """

    column: str
    instance: int
    status: Status
    optimum: int | None
    now: int
    stop_reason: str = ""
    mistake: Mistake | None = None

    @property
    def row(self) -> dict[str, Any]:
        """For rows.csv."""
        names = ("column", "instance", "status", "optimum", "now", "stop_reason")
        mistake = [getattr(self.mistake, name, None) for name in ("number", "now", "before", "after")]
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
            board = replace(board, stop_reason=tried.reason, mistake=mistake_of(problem, proof, tried, exact))
        found.append(board)
    return found


def mistake_of(problem: Problem, proof: Plan, tried: Plan, exact: Planner) -> Mistake | None:
    """The first mistake of the network's plan; None where it stops before one."""
    for before, after in pairwise(panels_of(problem, tried)):
        (then,) = exact.plan(Batch.of(after.problem))
        if then.optimal_moves != len(proof.moves) - 1:
            now = int(corridor_costs(problem.reach, *Batch.of(before.problem)).now)
            return Mistake(before, now, proof.moves[0], len(proof.moves), then.optimal_moves)
        proof = then
    return None


def drawn_of(columns: Sequence[Sequence[Board]]) -> list[Board]:
    """The first failing boards of each column in turn, `MOST` in all, those of a column together."""
    each = [[board for board in boards if board.mistake is not None] for boards in columns]
    turns = [(place, one) for turn in zip_longest(*each) for place, one in enumerate(turn) if one is not None]
    return [one for _, one in sorted(turns[:MOST], key=lambda turn: turn[0])]


def draw(path: Path, columns: Sequence[Sequence[Board]]) -> None:
    """Write the PNG, two boards a failure, two failures a line; no file where nothing fails."""
    drawn = drawn_of(columns)
    if not drawn:
        path.unlink(missing_ok=True)
        return
    down, across = -(-len(drawn) // 2), 2 * min(2, len(drawn))
    edge = CELL_INCH * max(int(board.column.partition("x")[0]) for board in drawn)
    above_legend = ConstrainedLayoutEngine(rect=(0, 0.03, 1, 0.97))
    figure = Figure(((edge + 0.2) * across, (edge + 0.8) * down + 0.4), facecolor="white", layout=above_legend)
    places = list(figure.subplots(down, across, squeeze=False).flat)
    for axes in places:
        axes.axis("off")
    for axes, (title, panel) in zip(places, [side for board in drawn for side in sides(board)], strict=False):
        axes.set_title(title, fontsize=8.5, color=INK, pad=3)
        draw_panel(axes, panel)
    draw_legend(figure, tuple(LEGEND), columns=4, scale=1.2)
    save_figure(figure, path)


def sides(board: Board) -> list[tuple[str, Panel]]:
    """The titles and the boards of a failure: a shortest plan's move, the network's move."""
    mistake = board.mistake
    if mistake is None:
        return []
    move, best = mistake.panel, replace(mistake.panel, move=mistake.best)
    left = f"{mistake.after} left" if mistake.after is not None else "no plan proved"
    size, obstacles = board.column.replace("x", " x ").split("_z")
    shortest = f"a shortest plan: {best.words}, {mistake.before - 1} left"
    networks = f"the network's move {mistake.number}: {move.words}, {left}"
    return [
        (f"{size}, {obstacles} obstacles, no. {board.instance}\n{shortest}", best),
        (f"optimum {board.optimum}, costs {board.now}\n{networks}", move),
    ]


if __name__ == "__main__":
    sys.exit(run(main, Options))
