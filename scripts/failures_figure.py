"""The failures' picture: each board twice, with a shortest plan's next move and with the network's."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from dore.draw.board_art import INK, LEGEND
from dore.draw.boards import PANEL_LEGEND_INCH, Panel, panel_pixels
from dore.files import atomic_write
from dore.world.plan import Move
from scripts.failures_found import Board, Column, Mistake
from scripts.failures_page import ENDINGS

MOST = 6
"""Boards that are drawn."""
WIDTH_PX = 640
INCH, GAP_INCH, HEAD_INCH, FOOT_INCH = 3.0, 0.15, 0.72, 0.4
"""Width of a board; between boards; above each for its words; below all for the legend."""
DPI = 160


def drawn_of(columns: Sequence[Column]) -> list[tuple[Column, Board, Mistake]]:
    """The first failing boards of each column in turn, `MOST` in all."""
    each = [[(one, board, board.mistake) for board in one.failed if board.mistake is not None] for one in columns]
    turns = [one for turn in zip_longest(*each) for one in turn if one is not None]
    return sorted(turns[:MOST], key=lambda one: columns.index(one[0]))


def draw(path: Path, drawn: Sequence[tuple[Column, Board, Mistake]]) -> None:
    """Write the PNG: two boards a failure, two failures a line."""
    pictures = [
        [_pixels(column, mistake, move) for move in (mistake.best, mistake.move)] for column, _, mistake in drawn
    ]
    tall = [INCH * both[0].shape[0] / WIDTH_PX for both in pictures]
    across = min(2, len(drawn))
    lines = [max(tall[first : first + across]) + HEAD_INCH for first in range(0, len(drawn), across)]
    size = (across * 2 * (INCH + GAP_INCH) + GAP_INCH, sum(lines) + FOOT_INCH)
    figure = Figure(size, facecolor="white")
    for index, ((column, board, mistake), both) in enumerate(zip(drawn, pictures, strict=True)):
        line, place = divmod(index, across)
        top = size[1] - sum(lines[:line]) - HEAD_INCH
        left = GAP_INCH + place * 2 * (INCH + GAP_INCH)
        words = (left + INCH + GAP_INCH / 2) / size[0], (top + 0.3) / size[1]
        figure.text(*words, _head(column, board), ha="center", va="bottom", fontsize=9.5, color=INK, weight="bold")
        for offset, picture, title in zip((0, INCH + GAP_INCH), both, _titles(column, mistake), strict=True):
            box = (left + offset) / size[0], (top - tall[index]) / size[1], INCH / size[0], tall[index] / size[1]
            axes = figure.add_axes(box)
            axes.imshow(picture, interpolation="lanczos")
            axes.set_title(title, fontsize=8.5, color=INK, pad=3)
            axes.axis("off")
    handles = [
        Patch(facecolor=colour, alpha=alpha, label=name.removesuffix(" and its corridor"))
        for name, (colour, alpha) in LEGEND.items()
    ]
    figure.legend(handles=handles, loc="lower center", ncols=4, fontsize=8.5, frameon=False, labelcolor=INK)
    with atomic_write(path, "wb") as file:
        figure.savefig(file, format="png", dpi=DPI)


def _pixels(column: Column, mistake: Mistake, move: Move) -> NDArray[np.uint8]:
    """A board with one move, without the legend that each panel has."""
    panel = Panel(mistake.problem, move, number=mistake.number)
    pixels = panel_pixels(panel, WIDTH_PX, 4 * WIDTH_PX, {})
    # The legend lies below the board and grows with it.
    legend = round(WIDTH_PX * PANEL_LEGEND_INCH[1] / PANEL_LEGEND_INCH[0])
    return pixels[: pixels.shape[0] - legend]


def _head(column: Column, board: Board) -> str:
    ending = ENDINGS.get(board.ending, board.ending)
    return f"{column.title}, no. {board.instance}: optimum {board.optimum}, costs {board.now}; {ending}"


def _titles(column: Column, mistake: Mistake) -> tuple[str, str]:
    """What stands above a failure's two boards."""
    best, move = (Panel(mistake.problem, one).words for one in (mistake.best, mistake.move))
    left = f"{mistake.after} left" if mistake.after is not None else "no plan proved"
    return (
        f"a shortest plan: {best}, {mistake.optimum - 1} left",
        f"the network's move {mistake.number}: {move}, {left}",
    )
