"""The failures' picture: each board twice, with a shortest plan's next move and with the network's."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from dore.draw import style
from dore.draw.board_art import INK, LEGEND
from dore.draw.boards import PANEL_LEGEND_INCH, Panel, panel_pixels
from dore.world.plan import Move

if TYPE_CHECKING:
    from scripts.failures import Board, Mistake

MOST = 6
"""Boards that are drawn."""
WIDTH_PX = 640


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
    figure = Figure((3.15 * across, 3.7 * down + 0.4), facecolor="white", layout="constrained")
    places = list(figure.subplots(down, across, squeeze=False).flat)
    for axes in places:
        axes.axis("off")
    for number, board in enumerate(drawn):
        for axes, (title, pixels) in zip(places[2 * number :], _sides(board), strict=False):
            axes.imshow(pixels, interpolation="lanczos")
            axes.set_title(title, fontsize=8.5, color=INK, pad=3)
    handles = [
        Patch(facecolor=colour, alpha=alpha, label=name.removesuffix(" and its corridor"))
        for name, (colour, alpha) in LEGEND.items()
    ]
    look = {"ncols": 4, "fontsize": 8.5, "frameon": False, "labelcolor": INK}
    figure.legend(handles=handles, loc="outside lower center", **look)
    style.save_figure(figure, path)


def _sides(board: Board) -> list[tuple[str, NDArray[np.uint8]]]:
    """The words and the pictures of a failure: a shortest plan's move, the network's move."""
    mistake = board.mistake
    if mistake is None:
        return []
    best, move = (Panel(mistake.problem, one).words for one in (mistake.best, mistake.move))
    left = f"{mistake.after} left" if mistake.after is not None else "no plan proved"
    size, obstacles = board.column.replace("x", " x ").split("_z")
    titles = (
        f"{size}, {obstacles} obstacles, no. {board.instance}\na shortest plan: {best}, {mistake.optimum - 1} left",
        f"optimum {board.optimum}, costs {board.now}\nthe network's move {mistake.number}: {move}, {left}",
    )
    return list(zip(titles, (_pixels(mistake, one) for one in (mistake.best, mistake.move)), strict=True))


def _pixels(mistake: Mistake, move: Move) -> NDArray[np.uint8]:
    """A board with one move, without the legend that each panel has."""
    pixels = panel_pixels(Panel(mistake.problem, move, number=mistake.number), WIDTH_PX, 4 * WIDTH_PX, {})
    # The legend lies below the board and grows with it.
    legend = round(WIDTH_PX * PANEL_LEGEND_INCH[1] / PANEL_LEGEND_INCH[0])
    return pixels[: pixels.shape[0] - legend]
