"""The dense boards that the network fails on though a plan is proved, and how each of its tries goes wrong.

python -m scripts.failures out=FOLDER [model=FILE] [worlds=[3x6_wide_hand,...]] [boards=500] [picture=FILE]
Boards are of `instances=dense`, of the validation split, so that the test split stays unseen. FOLDER/rows.csv has a row
a board, and the picture the first failing ones; `dore-report study=failures` makes the page.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise, zip_longest
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import Tensor

from dore.app import build
from dore.draw.board_art import LEGEND, draw_legend
from dore.draw.boards import Panel, draw_panel, panels_of
from dore.draw.style import INK, save_figure
from dore.errors import InputError
from dore.learn.checkpoint import SHIPPED
from dore.learn.corridor_features import corridor_costs
from dore.planners.base import Planner
from dore.report.measurements import write_measurements
from dore.report.panels import panels
from dore.world.labeller import UNKNOWN, Labeller
from dore.world.plan import Plan, Status
from dore.world.problem import Batch, Problem
from scripts.program import composed, run

MOST = 6
"""Boards that are drawn."""
PROOF_S = 10.0
"""A proof is given up after so many seconds of its own."""
MAX_NODES, MAX_MOVES = 100_000, 40
"""Of the search that says which choices are those of a shortest plan."""
WORLDS = ("3x6_wide_hand", "3x6_paper_fit", "6x6_wide_hand", "6x6_paper_fit")


@dataclass(frozen=True)
class Options:
    """out: the folder of the rows. model: a run directory or a model file. boards: of each world."""

    out: Path
    model: Path = SHIPPED
    worlds: list[str] = field(default_factory=lambda: list(WORLDS))
    boards: int = 500
    picture: Path = Path("docs/results/failures.png")

    def __post_init__(self) -> None:
        if not self.worlds:
            raise InputError("worlds: got [], want one or more")
        for name in self.worlds:
            if not re.fullmatch(r"\d+x\d+_[a-z_]+", name):
                raise InputError(f"worlds: got {name!r}, want LAYOUT_REACH, as 3x6_paper_fit")


class Board(NamedTuple):
    """A validation board: its row, and where the network's plan goes wrong, if it does.

    Of the row: instance: the number in the set, from 1. obstacles: how many. optimum: the proved fewest moves. now: the
    corridor cost. stop_reason: why the network's plan stops without the target, empty where it does not. made: its
    moves; nearest: the fewest moves that were left on the way; nearer, level, farther: how many of its moves brought
    the end nearer, kept the distance or took it farther away. mistake: the number of the first move after which no
    plan of one move fewer is proved, from 1; before, after: the fewest moves before and after it, `after` empty where
    there is no plan, or no proof in time; choice: what was wrong: `pick`, no place for this obstacle would have been
    optimal; `place`, another one would; `not decided`.

    mistake: the board before that move, and the move. best: the same board, and the first move of a shortest plan.
    """

    row: dict[str, Any]
    mistake: Panel | None
    best: Panel | None


def main(options: Options) -> None:
    """Write the rows and the picture."""
    worlds = [boards_of(name, options.model, options.boards) for name in options.worlds]
    rows = [board.row for boards in worlds for board in boards]
    write_measurements(options.out, rows, weights=options.model.name, proof_s=PROOF_S)
    options.picture.parent.mkdir(parents=True, exist_ok=True)
    draw(options.picture, worlds)


def boards_of(name: str, model: Path, boards: int) -> list[Board]:
    """So many validation boards of a world, planned by the network and by exact search.

    Raises:
        InputError: no such model, or not so many boards.
    """
    layout, _, reach_name = name.partition("_")
    world = [f"layout={layout}", f"reach={reach_name}", "instances=dense", f"instances.validation_size={boards}"]
    planners = ["planner=[learned,exact]", f"planners.exact.max_seconds={PROOF_S}", f"model={model}"]
    cfg = composed("evaluate", *world, *planners)
    reach = build.reach_of(cfg, "cpu")
    learned, exact = build.planners_of(cfg, reach)
    instances = build.splits_of(cfg, reach).validation(reach)
    batch, labeller = instances.batch(), Labeller(reach, MAX_NODES, MAX_MOVES)
    costs = corridor_costs(reach, *batch).now.tolist()
    found = []
    for number, (problem, proof, tried, now) in enumerate(
        zip(instances, exact.plan(batch), learned.plan(batch), costs, strict=True), 1
    ):
        failed = proof.status is Status.SOLVED and tried.status is not Status.SOLVED
        row = {"world": name, "instance": number, "obstacles": len(problem.scene.obstacles)}
        row |= {"optimum": proof.optimal_moves, "now": now, "stop_reason": tried.reason if failed else ""}
        way, *drawn = way_of(problem, tried, exact, labeller) if failed else Board({}, None, None)
        found.append(Board(row | {key: way.get(key) for key in WAY}, *drawn))
    return found


WAY = ("made", "nearest", "nearer", "level", "farther", "mistake", "before", "after", "choice")
"""What a row says of a failing plan."""


def way_of(problem: Problem, tried: Plan, exact: Planner, labeller: Labeller) -> Board:
    """How the distance to the end changes along the network's plan, and its first mistake, if it makes one."""
    shown = panels_of(problem, tried)
    boards = [Batch.of(panel.problem) for panel in shown]
    plans = exact.plan(Batch(torch.cat([one.board for one in boards]), torch.cat([one.target for one in boards])))
    left = [plan.optimal_moves for plan in plans]
    steps = [None if None in (a, b) else b - a for a, b in pairwise(left)]  # type: ignore[operator]
    way = {"made": len(tried.moves), "nearest": min(one for one in left if one is not None)}
    way |= {"nearer": steps.count(-1), "level": steps.count(0), "farther": steps.count(1)}
    wrong = next((index for index, step in enumerate(steps) if step != -1), None)
    if wrong is None or left[wrong] is None:
        return Board(way, None, None)
    panel, wasted = shown[wrong], labeller.label(boards[wrong]).wasted[0]
    choice = choice_of(wasted[panel.move.pick]) if panel.move else "not decided"
    way |= {"mistake": wrong + 1, "before": left[wrong], "after": left[wrong + 1], "choice": choice}
    return Board(way, panel, replace(panel, move=plans[wrong].moves[0]))


def choice_of(wasted: Tensor) -> str:
    """What was wrong, from the labels Int8[G] of the picked obstacle's places."""
    if bool((wasted == 0).any()):
        return "place"
    return "not decided" if bool((wasted == UNKNOWN).any()) or not bool((wasted >= 0).any()) else "pick"


def drawn_of(worlds: Sequence[Sequence[Board]]) -> list[Board]:
    """Failing boards of all worlds in turn, `MOST` in all."""
    each = [[board for board in boards if board.mistake is not None] for boards in worlds]
    turns = [board for turn in zip_longest(*each) for board in turn if board is not None]
    return turns[:MOST]


def draw(path: Path, worlds: Sequence[Sequence[Board]]) -> None:
    """Write the PNG, two boards a failure, two failures a line; none where nothing fails."""
    shown = [side for board in drawn_of(worlds) for side in sides(board)]
    if not shown:
        return
    figure, places = panels(len(shown), 4, 3.4, 4.0)
    for axes, (title, panel) in zip(places, shown, strict=True):
        axes.set_title(title, fontsize=8.5, color=INK, pad=3)
        draw_panel(axes, panel)
    draw_legend(figure, tuple(LEGEND), columns=4, scale=1.2)
    save_figure(figure, path)


def sides(board: Board) -> list[tuple[str, Panel]]:
    """The titles and the boards of a failure: a shortest plan's move, the network's move."""
    row, mistake, best = board
    if mistake is None or best is None:
        return []
    left = "no plan proved" if row["after"] is None else f"{row['after']} left"
    layout, _, reach = row["world"].partition("_")
    name = f"{layout.replace('x', ' x ')}, {reach}, {row['obstacles']} obstacles, no. {row['instance']}"
    return [
        (f"{name}\na shortest plan: {best.words}, {row['before'] - 1} left", best),
        (
            f"optimum {row['optimum']}; wrong {row['choice']}\n"
            f"the network's move {row['mistake']}: {mistake.words}, {left}",
            mistake,
        ),
    ]


if __name__ == "__main__":
    sys.exit(run(main, Options))
