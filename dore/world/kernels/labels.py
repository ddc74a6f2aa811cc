"""What every legal move of a board is worth: how much longer it leaves the shortest plan. `dore.world.labeller`."""

from __future__ import annotations

import numpy as np

from dore.world.kernels.bits import Board, bit, first, minus, rest, row, some, union
from dore.world.kernels.compiling import entry, kernel
from dore.world.kernels.rules import accessible_of
from dore.world.kernels.search import advance, begin
from dore.world.kernels.slices import (
    EXPANSIONS,
    FULL,
    LOCKED,
    MAX_MOVES,
    N_MOVES,
    ROW,
    RUNNING,
    SOLVED,
    TOO_LONG,
    UNSOLVABLE,
    Work,
)
from dore.world.kernels.store import Store
from dore.world.kernels.tables import Table

NO_PLAN, UNDECIDED = -1, -2
"""In place of a board's fewest moves: proved to have no plan; given up, or longer than was looked for."""
ILLEGAL, UNKNOWN = -1, -2
"""In place of the moves that a move wastes: not allowed; given up."""
NEVER_NS = 1 << 62


@kernel
def attempt(table: Table, board: Board, target: int, work: Work, store: Store) -> int:
    """Search one board in one store: how it ended."""
    work.at[ROW] = 0
    work.found[0, N_MOVES] = 0
    outcome = begin(table, board, target, work, store)
    if outcome == RUNNING:
        outcome = advance(table, board, target, work, store, 0, NEVER_NS)
    return outcome


@kernel
def fewest_moves(
    table: Table, board: Board, target: int, most: int, work: Work, small: Store, large: Store
) -> tuple[int, int]:
    """The fewest moves, looked for up to `most`, and how the search ended; the large store is long to clear."""
    work.limits[MAX_MOVES] = most
    outcome = attempt(table, board, target, work, small)
    expansions = work.at[EXPANSIONS]
    if outcome == FULL:
        outcome = attempt(table, board, target, work, large)
        work.at[EXPANSIONS] += expansions
    if outcome == SOLVED:
        return work.found[0, N_MOVES], outcome
    return NO_PLAN if outcome == UNSOLVABLE or outcome == LOCKED else UNDECIDED, outcome


@kernel
def label_moves(
    table: Table, board: Board, target: int, fewest: int, work: Work, small: Store, large: Store, wasted: np.ndarray
) -> int:
    """Write int8[G, G], for each pick and place the moves that it wastes; the boards expanded.

    Every move can be taken back, so the board after it is one move nearer the goal, as far, or one farther: a search
    that looks for no more than `fewest` moves tells which, and one more is what it rules out.
    """
    target_bit, expansions = bit(target, board), 0
    picks = accessible_of(table, union(board, target_bit), board)
    while some(picks):
        pick = first(picks)
        picks = rest(picks)
        lifted = minus(board, bit(pick, board))
        standing = union(lifted, target_bit)
        places = accessible_of(table, standing, minus(minus(table.full, standing), bit(pick, board)))
        while some(places):
            cell = first(places)
            places = rest(places)
            left, outcome = fewest_moves(table, union(lifted, bit(cell, board)), target, fewest, work, small, large)
            expansions += work.at[EXPANSIONS]
            if left >= 0:
                wasted[pick, cell] = left + 1 - fewest
            else:
                wasted[pick, cell] = 2 if outcome == TOO_LONG else UNKNOWN
    return expansions


@entry
def label(
    table: Table,
    boards: np.ndarray,
    targets: np.ndarray,
    most: int,
    enough: int,
    work: Work,
    small: Store,
    large: Store,
    fewest: np.ndarray,
    wasted: np.ndarray,
) -> int:
    """The fewest moves int16[B] of uint64[B, W] boards, up to `most`, and int8[B, G, G] moves wasted.

    Stops before the next board once `enough` boards were expanded in all; returns how many rows are done. Where
    `wasted` has no rows only the fewest moves are found; it holds ILLEGAL everywhere before.
    """
    expansions = 0
    for i in range(len(boards)):
        if expansions >= enough:
            return i
        board = row(boards[i], table.full)
        fewest[i], _ = fewest_moves(table, board, targets[i], most, work, small, large)
        expansions += work.at[EXPANSIONS]
        if fewest[i] > 0 and len(wasted) > 0:
            expansions += label_moves(table, board, targets[i], fewest[i], work, small, large, wasted[i])
    return len(boards)
