"""The fewest rearrangements, proved: A* over boards. `dore.planners.exact` says what it rests on."""

from __future__ import annotations

import numpy as np

from dore.world.kernels.bits import Board, bit, both, count, first, minus, nothing, rest, row, some, union
from dore.world.kernels.bound import NEVER, Ways, may_open
from dore.world.kernels.compiling import entry, kernel
from dore.world.kernels.rules import accessible, accessible_of, peeled
from dore.world.kernels.slices import (
    BOUND,
    BUDGET,
    EXCESS,
    EXPANSIONS,
    LOCKED,
    MAX_MOVES,
    N_MOVES,
    ROW,
    RUNNING,
    SOLVED,
    STARTED,
    TOO_LONG,
    UNSOLVABLE,
    Fields,
    Work,
    begin_at_zero,
    resume,
    spent,
    turn,
)
from dore.world.kernels.store import (
    DONE,
    MOVES,
    NOBODY,
    NOWHERE,
    PLACED,
    Store,
    add,
    next_excess,
    queue,
    report,
    unqueue,
)
from dore.world.kernels.tables import Table

MAX_TRIED = 100_000
"""Ways tried in one expansion, after which all corridors are taken for open, so that none takes long."""


@kernel
def begin(table: Table, board: Board, target: int, work: Work, store: Store) -> int:
    """Put the start board in line, unless nothing needs to be searched."""
    at = work.at
    begin_at_zero(work, store, board)
    if accessible(table, board, target):
        return SOLVED
    if not accessible(table, peeled(table, board, bit(target, board), board), target):
        return LOCKED
    fewest = NEVER
    for d in range(table.n_corridors[target]):
        fewest = min(fewest, count(both(row(table.corridors[target, d], board), board)))
    at[BOUND] = at[BUDGET] = fewest
    queue(store, 0, fewest, add(store, board, -1, 0, NOWHERE))
    return TOO_LONG if fewest > work.limits[MAX_MOVES] else RUNNING


@kernel
def next_budget(work: Work, store: Store) -> int:
    """Turn to the least budget at which a node is in line, and to the next excess where none is."""
    at = work.at
    while at[BUDGET] <= at[BOUND] + at[EXCESS] and store.head[0, at[BUDGET]] < 0:
        at[BUDGET] += 1
    if at[BUDGET] <= at[BOUND] + at[EXCESS]:
        return RUNNING
    at[EXCESS] += 1
    at[BUDGET] = next_excess(store, at[BOUND] + at[EXCESS])
    if at[BUDGET] == NOBODY:
        return UNSOLVABLE
    return TOO_LONG if at[BOUND] + at[EXCESS] > work.limits[MAX_MOVES] else RUNNING


@kernel
def open_corridors(table: Table, board: Board, target: int, budget: int, work: Work) -> tuple[int, int, Board]:
    """Which corridors of the target may be cleared within the budget, into `work.is_open`.

    Returns how many, the fewest obstacles on one, and the cells of which an obstacle may be picked first.
    """
    target_bit, n_open, least, useful = bit(target, board), 0, NEVER, nothing(board)
    work.ways.effort[1] = work.ways.effort[0] + MAX_TRIED
    for d in range(table.n_corridors[target]):
        corridor = row(table.corridors[target, d], board)
        blocking = count(both(corridor, board))
        if blocking <= budget and may_open(table, board, target_bit, corridor, budget - blocking, work.ways):
            work.is_open[n_open] = d
            n_open += 1
            least = min(least, blocking)
            useful = union(useful, corridor if blocking == budget else table.full)
    return n_open, least, useful


@kernel
def useful_places(table: Table, lifted: Board, target: int, budget: int, work: Work, n_open: int) -> Board:
    """Cells on which a lifted obstacle leaves a corridor of the target that budget - 1 moves may clear."""
    found = nothing(lifted)
    for k in range(n_open):
        corridor = row(table.corridors[target, work.is_open[k]], lifted)
        blocking = count(both(corridor, lifted))
        if blocking < budget - 1:
            return table.full
        if blocking == budget - 1:
            found = union(found, minus(table.full, corridor))
    return found


@kernel
def place(store: Store, lifted: Board, places: Board, node: int, budget: int) -> int:
    """Add the boards with the lifted obstacle on each of the cells; the one that opens the target, or -1."""
    moves = store.about[node, MOVES] + 1
    while some(places):
        cell = first(places)
        places = rest(places)
        found = add(store, union(lifted, bit(cell, lifted)), node, moves, cell)
        if found >= 0:
            if budget == 1:
                return found
            queue(store, 0, budget - 1, found)
    return -1


@kernel
def expand(table: Table, target: int, work: Work, store: Store, node: int) -> int:
    """Expand a node with a budget of moves; the node that opens the target, or -1."""
    board, budget = row(store.board[node], table.full), work.at[BUDGET]
    n_open, least, useful = open_corridors(table, board, target, budget, work)
    if n_open == 0:
        queue(store, 1, budget + 1, node)
        return -1
    if store.about[node, DONE] == 0:
        work.at[EXPANSIONS] += 1
    target_bit = bit(target, board)
    standing = union(board, target_bit)
    picks = accessible_of(table, standing, both(board, useful))
    if store.about[node, PLACED] != NOWHERE:
        picks = minus(picks, bit(store.about[node, PLACED], board))
    empty = minus(table.full, standing)
    open_before = accessible_of(table, standing, empty)
    while some(picks):
        pick = first(picks)
        picks = rest(picks)
        lifted = minus(board, bit(pick, board))
        places = both(useful_places(table, lifted, target, budget, work, n_open), empty)
        known = both(places, open_before)
        opened = accessible_of(table, union(lifted, target_bit), minus(places, known))
        goal = place(store, lifted, union(known, opened), node, budget)
        if goal >= 0:
            return goal
    store.about[node, DONE] = budget
    if least > budget - 2:
        queue(store, 1, budget + 1, node)
    return -1


@kernel
def advance(table: Table, board: Board, target: int, work: Work, store: Store, began: int, slice_ends: int) -> int:
    """Search on, until the board is decided or given up, or the slice ends, or the store is full."""
    at, n_obstacles = work.at, count(board)
    most_new = n_obstacles * (count(table.full) - n_obstacles) + 1
    while True:
        outcome = next_budget(work, store)
        if outcome == RUNNING:
            outcome = spent(work, store, at[EXPANSIONS], most_new, began, slice_ends)
        if outcome != RUNNING:
            return outcome
        node = unqueue(store, at[BUDGET])
        if store.about[node, MOVES] != at[BOUND] + at[EXCESS] - at[BUDGET]:
            continue  # Reached by fewer moves since.
        goal = expand(table, target, work, store, node)
        if goal >= 0:
            work.found[at[ROW], N_MOVES] = report(store, goal, board, work.moves[at[ROW]])
            return SOLVED
        at[BUDGET] = max(at[BUDGET] - 1, 0)


@entry
def search(table: Fields, boards: np.ndarray, targets: np.ndarray, work: Fields, ways: Fields, store: Fields) -> int:
    """A* on uint64[B, W] boards and int64[B] targets, from `work.at[ROW]` on.

    Returns PAUSED when the slice ends, FULL when the store has to grow, RUNNING when all boards are done.
    """
    return run_on(Table(*table), boards, targets, Work(*(*work, Ways(*ways))), Store(*store))


@kernel
def run_on(table: Table, boards: np.ndarray, targets: np.ndarray, work: Work, store: Store) -> int:
    """`search`, with names."""
    began, slice_ends, outcome = resume(work, store, table.full)
    while outcome == RUNNING and work.at[ROW] < len(boards):
        board, target = row(boards[work.at[ROW]], table.full), targets[work.at[ROW]]
        if work.at[STARTED] == 0:
            outcome = begin(table, board, target, work, store)
        if outcome == RUNNING:
            outcome = advance(table, board, target, work, store, began, slice_ends)
        began, outcome = turn(work, store, outcome, began, slice_ends)
    return outcome
