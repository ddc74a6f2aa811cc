"""The failures' picture: each board twice, with a shortest plan's next move and with the network's."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from dore.draw.board_art import CELL_INCH, LEGEND, draw_legend
from dore.draw.boards import Panel, draw_panel
from dore.draw.style import INK, save_figure

if TYPE_CHECKING:
    from scripts.failures import Board

MOST = 6
"""Boards that are drawn."""


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
    best, move = (Panel(mistake.problem, one, number=mistake.number) for one in (mistake.best, mistake.move))
    left = f"{mistake.after} left" if mistake.after is not None else "no plan proved"
    size, obstacles = board.column.replace("x", " x ").split("_z")
    shortest = f"a shortest plan: {best.words}, {mistake.optimum - 1} left"
    networks = f"the network's move {mistake.number}: {move.words}, {left}"
    return [
        (f"{size}, {obstacles} obstacles, no. {board.instance}\n{shortest}", best),
        (f"optimum {board.optimum}, costs {board.now}\n{networks}", move),
    ]
