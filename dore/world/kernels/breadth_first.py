"""The fewest rearrangements by breadth-first search, without a bound: `dore.planners.graph_search`."""

from __future__ import annotations

import numpy as np

from dore.world.kernels.bits import Board, bit, count, first, minus, rest, row, some, union
from dore.world.kernels.bound import Ways
from dore.world.kernels.compiling import entry, kernel
from dore.world.kernels.rules import accessible, accessible_of
from dore.world.kernels.slices import (
    EXCESS,
    EXPANSIONS,
    N_MOVES,
    ROW,
    RUNNING,
    SOLVED,
    STARTED,
    UNSOLVABLE,
    Fields,
    Work,
    begin_at_zero,
    resume,
    spent,
    turn,
)
from dore.world.kernels.store import MOVES, NODES, NOWHERE, Store, add, report
from dore.world.kernels.tables import Table


@kernel
def begin(table: Table, board: Board, target: int, work: Work, store: Store) -> int:
    """Make the start board the first node, unless its target is accessible."""
    begin_at_zero(work, store, board)
    add(store, board, -1, 0, NOWHERE)
    return SOLVED if accessible(table, board, target) else RUNNING


@kernel
def expand(table: Table, target: int, store: Store, node: int) -> int:
    """Make the nodes one move from a node; the first of them where the target is accessible, or -1."""
    board = row(store.board[node], table.full)
    target_bit = bit(target, board)
    picks = accessible_of(table, union(board, target_bit), board)
    while some(picks):
        pick = first(picks)
        picks = rest(picks)
        lifted = minus(board, bit(pick, board))
        standing = union(lifted, target_bit)
        places = accessible_of(table, standing, minus(table.full, standing))
        while some(places):
            cell = first(places)
            places = rest(places)
            after = union(lifted, bit(cell, board))
            found = add(store, after, node, store.about[node, MOVES] + 1, cell)
            if found >= 0 and accessible(table, after, target):
                return found
    return -1


@kernel
def advance(table: Table, board: Board, target: int, work: Work, store: Store, began: int, slice_ends: int) -> int:
    """Expand the nodes in the order that they were made in; `at[EXPANSIONS]` is the next."""
    at, n_obstacles = work.at, count(board)
    most_new = n_obstacles * (count(table.full) - n_obstacles) + 1
    while at[EXPANSIONS] < store.size[NODES]:
        outcome = spent(work, store, store.size[NODES], most_new, began, slice_ends)
        if outcome != RUNNING:
            return outcome
        at[EXCESS] = store.about[at[EXPANSIONS], MOVES] + 1  # No plan has fewer moves.
        goal = expand(table, target, store, at[EXPANSIONS])
        at[EXPANSIONS] += 1
        if goal >= 0:
            work.found[at[ROW], N_MOVES] = report(store, goal, board, work.moves[at[ROW]])
            return SOLVED
    return UNSOLVABLE


@entry
def breadth_first(
    table: Fields, boards: np.ndarray, targets: np.ndarray, work: Fields, ways: Fields, store: Fields
) -> int:
    """Breadth-first search on uint64[B, W] boards and int64[B] targets, from `work.at[ROW]` on.

    Returns PAUSED when the slice ends, FULL when the store has to grow, RUNNING when all boards are done.
    """
    return run_on(Table(*table), boards, targets, Work(*(*work, Ways(*ways))), Store(*store))


@kernel
def run_on(table: Table, boards: np.ndarray, targets: np.ndarray, work: Work, store: Store) -> int:
    """`breadth_first`, with names."""
    began, slice_ends, outcome = resume(work, store, table.full)
    while outcome == RUNNING and work.at[ROW] < len(boards):
        board, target = row(boards[work.at[ROW]], table.full), targets[work.at[ROW]]
        if work.at[STARTED] == 0:
            outcome = begin(table, board, target, work, store)
        if outcome == RUNNING:
            outcome = advance(table, board, target, work, store, began, slice_ends)
        began, outcome = turn(work, store, outcome, began, slice_ends)
    return outcome
