"""The bound of the exact search: how few moves may clear a corridor of the target, in the delete relaxation.

There a moved obstacle vanishes (Hoffmann and Nebel, 2001). A vanished obstacle blocks nothing, and one more never
closes a corridor: whatever a plan of m moves opens, its obstacles open by vanishing in the order of their first moves.
So the fewest vanishings that make the target accessible, h+, are an admissible bound. It is consistent too, since a
move and the vanishings after it are vanishings that are possible before it. Each corridor of the target has its own
bound; h+ is the least of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dore.world.kernels.bits import (
    Board,
    both,
    count,
    first,
    meets,
    minus,
    nothing,
    rest,
    row,
    same,
    some,
    union,
    write,
)
from dore.world.kernels.compiling import kernel
from dore.world.kernels.rules import peeled
from dore.world.kernels.tables import Table

NEVER = 1 << 20
"""More obstacles than any corridor has."""
MAX_WAYS = 2048
"""Where a test finds more ways to clear a corridor than this, the corridor is taken for open."""


class Ways(NamedTuple):
    """Room for the ways to clear a corridor that are being tried, N = MAX_WAYS of them.

    board, wanted: uint64[N, W], what stands, and what of it has yet to move. spare: int64[N], moves left beside those.
    effort: int64[2], how many ways have ever been tried, and at how many the tests end: corridors are taken for open.
    """

    board: np.ndarray
    wanted: np.ndarray
    spare: np.ndarray
    effort: np.ndarray


def new_ways(words: int) -> Ways:
    """Room for one search at a time."""
    board, wanted = np.empty((2, MAX_WAYS, words), np.uint64)
    return Ways(board, wanted, np.empty(MAX_WAYS, np.int64), np.zeros(2, np.int64))


@kernel
def must_go(table: Table, board: Board, target: Board, wanted: Board, cell: int) -> tuple[Board, int]:
    """What stands on every corridor of a wanted obstacle, and the fewest more that one of them adds to `wanted`."""
    fewest, on_all = NEVER, board
    for d in range(table.n_corridors[cell]):
        corridor = row(table.corridors[cell, d], board)
        if not meets(corridor, target):
            on_all = both(on_all, corridor)
            fewest = min(fewest, count(minus(both(corridor, board), wanted)))
    return on_all, fewest


@kernel
def settled(table: Table, board: Board, target: Board, wanted: Board, spare: int) -> tuple[Board, Board, int]:
    """Let go what can go, and want what has to go before it: all that stands on every corridor of a wanted obstacle.

    Returns the board left, what is wanted still, and the moves left to spare; below 0 where there are too few.
    """
    while True:
        board = peeled(table, board, target, wanted)
        wanted = both(wanted, board)
        if not some(wanted):
            return board, wanted, spare
        if spare == 0:
            return board, wanted, -1
        forced, cells = nothing(board), wanted
        while some(cells):
            on_all, fewest = must_go(table, board, target, wanted, first(cells))
            cells = rest(cells)
            if fewest > spare:
                return board, wanted, -1
            forced = union(forced, on_all)
        forced = minus(forced, wanted)
        if not some(forced):
            return board, wanted, spare
        spare -= count(forced)
        if spare < 0:
            return board, wanted, -1
        wanted = union(wanted, forced)


@kernel
def is_known(ways: Ways, n_ways: int, board: Board, wanted: Board) -> bool:
    """Whether that way is among those found."""
    for way in range(n_ways):
        if same(ways.wanted[way], wanted) and same(ways.board[way], board):
            return True
    return False


@kernel
def keep(ways: Ways, way: int, board: Board, wanted: Board, spare: int) -> None:
    """Put a way in its place."""
    write(ways.board[way], board)
    write(ways.wanted[way], wanted)
    ways.spare[way] = spare


@kernel
def branch(table: Table, target: Board, ways: Ways, way: int, n_ways: int) -> int:
    """Add the ways that clear one corridor of one wanted obstacle first; how many there are then, -1: one is clear.

    The next wanted obstacle to go needs one of its own corridors: the obstacles on it are wanted too, and count
    against what is to spare. A corridor with another wanted obstacle or the target on it is no choice: that obstacle
    would not be the next.
    """
    board, wanted, spare = row(ways.board[way], target), row(ways.wanted[way], target), ways.spare[way]
    closed, cells = union(wanted, target), wanted
    while some(cells):
        cell = first(cells)
        cells = rest(cells)
        for d in range(table.n_corridors[cell]):
            corridor = row(table.corridors[cell, d], board)
            blockers = both(corridor, board)
            cost = count(blockers)
            if cost > spare or meets(corridor, closed):
                continue
            ways.effort[0] += 1
            after, still, left = settled(table, board, target, union(wanted, blockers), spare - cost)
            if left >= 0 and not some(still):
                return -1
            # With nothing to spare there is nothing to try.
            if left <= 0 or is_known(ways, n_ways, after, still):
                continue
            if n_ways == MAX_WAYS:
                return -1
            keep(ways, n_ways, after, still, left)
            n_ways += 1
    return n_ways


@kernel
def may_open(table: Table, board: Board, target: Board, corridor: Board, spare: int, ways: Ways) -> bool:
    """Whether a corridor of the target may be cleared with `spare` moves beside those for the obstacles on it.

    False is a proof that it may not: all choices have been tried, those with most to spare first.
    """
    board, wanted, most = settled(table, board, target, both(board, corridor), spare)
    if most < 0 or not some(wanted):
        return most >= 0
    keep(ways, 0, board, wanted, most)
    n_ways = 1
    for spare_now in range(most, 0, -1):
        way = 0
        while way < n_ways:
            if ways.spare[way] == spare_now:
                n_ways = branch(table, target, ways, way, n_ways)
                if n_ways < 0 or ways.effort[0] >= ways.effort[1]:
                    return True
            way += 1
    return False
