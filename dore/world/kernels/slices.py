"""A search of many boards in slices of time: what it keeps from one call to the next, and how it runs.

A kernel returns to Python every `SLICE_NS`, so that Ctrl-C is heard, and where the store has to grow.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from dore.world.kernels.bits import Board
from dore.world.kernels.bound import Ways, new_ways
from dore.world.kernels.compiling import cpu_ns, kernel
from dore.world.kernels.store import (
    ENTRIES,
    MOST_MOVES,
    NODES,
    UNHASHED,
    Store,
    bytes_a_node,
    clear,
    grown,
    hash_some,
    new_store,
)
from dore.world.kernels.tables import Table

Fields = tuple[Any, ...]
"""Those of a `Table`, `Work`, `Ways` or `Store`, as a plain tuple: named ones would take numba 5 us more to pass."""

SLICE_NS = 50_000_000
TICK = 2000
"""Ways tried between two looks at the clock, some 100 us."""
EXPANSION = 8
"""What an expansion counts for beside them."""

SOLVED, UNSOLVABLE, LOCKED, OUT_OF_TIME, OUT_OF_NODES, OUT_OF_MEMORY, TOO_LONG, RUNNING, PAUSED, FULL = range(10)
"""How the search of a board ends; LOCKED: what blocks the target can never be reached, by the relaxation; or that it
goes on, that the slice is over, or that the store has to grow first."""

ROW, STARTED, BOUND, EXCESS, BUDGET, EXPANSIONS, SPENT_NS, NEXT_LOOK = range(8)
MAX_NS, MAX_NODES, MAX_ROOM, MAX_MOVES = range(4)
STATUS, N_MOVES, N_EXPANSIONS, N_SEEN, FEWEST, CPU_NS = range(6)

FIRST_ROOM = 512
"""Nodes that there is room for at first, beside those of one expansion."""
MOST_ROOM = 2**30 - 1
"""Nodes that 32 bits can number."""


class Work(NamedTuple):
    """The state of a search of B boards, and its results.

    at: int64[8], the row of the board in work and how far it is.
    limits: int64[4], for each board: CPU nanoseconds; nodes; how many nodes the store may hold; moves of a plan.
    found: int64[B, 6], of each board: how it ended; moves of the plan; boards expanded; boards seen; the fewest moves
        that are not ruled out; CPU nanoseconds.
    moves: int32[B, 2 * MOST_MOVES], the plans, (pick, place) in turn.
    is_open: int64[D], room for the corridors of a target. clock: int64[2], room for the clock.
    """

    at: np.ndarray
    limits: np.ndarray
    found: np.ndarray
    moves: np.ndarray
    is_open: np.ndarray
    clock: np.ndarray
    ways: Ways


@kernel
def begin_at_zero(work: Work, store: Store, like: Board) -> None:
    """Forget the board before. The clock is looked at after a while, or with little time at the first expansion."""
    at = work.at
    at[BOUND] = at[EXCESS] = at[BUDGET] = at[EXPANSIONS] = 0
    at[STARTED], at[NEXT_LOOK] = 1, work.ways.effort[0] + (TICK if work.limits[MAX_NS] > SLICE_NS else 0)
    clear(store, like)


@kernel
def spent(work: Work, store: Store, n_nodes: int, most_new: int, began: int, slice_ends: int) -> int:
    """Whether the search of a board may go on by one more expansion, which adds `most_new` boards at most."""
    at, effort, room = work.at, work.ways.effort, len(store.board)
    effort[0] += EXPANSION
    if effort[0] >= at[NEXT_LOOK]:
        at[NEXT_LOOK] = effort[0] + TICK
        now = cpu_ns(work.clock)
        if now - began > work.limits[MAX_NS]:
            return OUT_OF_TIME
        if now > slice_ends:
            return PAUSED
    if n_nodes >= work.limits[MAX_NODES]:
        return OUT_OF_NODES
    if max(store.size[NODES], store.size[ENTRIES] - room) + most_new > room:
        return FULL if room < work.limits[MAX_ROOM] else OUT_OF_MEMORY
    return RUNNING


@kernel
def resume(work: Work, store: Store, like: Board) -> tuple[int, int, int]:
    """Begin a slice: set the slots that are not set since the store has grown; like: any board.

    Returns when the board in work was begun and when the slice ends, in the clock's nanoseconds, and RUNNING or PAUSED.
    """
    now = cpu_ns(work.clock)
    began, slice_ends = now - work.at[SPENT_NS], now + SLICE_NS
    while store.size[UNHASHED] > 0:
        hash_some(store, TICK, like)
        if cpu_ns(work.clock) > slice_ends:
            work.at[SPENT_NS] = cpu_ns(work.clock) - began
            return began, slice_ends, PAUSED
    return began, slice_ends, RUNNING


@kernel
def turn(work: Work, store: Store, outcome: int, began: int, slice_ends: int) -> tuple[int, int]:
    """Turn to the next board if the one in work is decided or given up; its moves are kept already.

    Returns when the board now in work was begun, and RUNNING, PAUSED or FULL.
    """
    at, now = work.at, cpu_ns(work.clock)
    if outcome == PAUSED or outcome == FULL:
        at[SPENT_NS] = now - began
        return began, outcome
    found = work.found[at[ROW]]
    found[STATUS], found[CPU_NS], found[N_SEEN] = outcome, now - began, max(store.size[NODES], 1)
    found[N_EXPANSIONS], found[FEWEST] = at[EXPANSIONS], at[BOUND] + at[EXCESS]
    at[ROW] += 1
    at[STARTED] = at[SPENT_NS] = 0
    return now, PAUSED if now > slice_ends else RUNNING


class Limits(NamedTuple):
    """The budgets of each board: CPU seconds, nodes, and MiB of the boards seen."""

    seconds: float
    nodes: int
    megabytes: float


class Found(NamedTuple):
    """What a search found for B boards.

    rows: int64[B, 6], as in `Work.found`. moves: int32[B, 2 * MOST_MOVES], the plans, (pick, place) in turn.
    """

    rows: np.ndarray
    moves: np.ndarray

    @property
    def outcome(self) -> np.ndarray:
        """How each ended, one of those above."""
        return self.rows[:, STATUS]

    @property
    def n_moves(self) -> np.ndarray:
        """How many moves each plan has."""
        return self.rows[:, N_MOVES]

    @property
    def fewest(self) -> np.ndarray:
        """No plan has fewer moves."""
        return self.rows[:, FEWEST]

    @property
    def cpu_ns(self) -> np.ndarray:
        """CPU nanoseconds."""
        return self.rows[:, CPU_NS]


_kept = threading.local()
"""This thread's room from the call before: to allocate it again would take longer than most searches."""


class _Room(NamedTuple):
    """What a search needs beside its results; it may hold what the search before has left."""

    at: np.ndarray
    is_open: np.ndarray
    clock: np.ndarray
    ways: Ways
    store: Store


def _first_room(nodes: int, words: int, corridors: int) -> _Room:
    """Room for so many nodes, and for that many corridors of a target."""
    if getattr(_kept, "size", None) != (nodes, words, corridors):
        at, is_open, clock = np.zeros(8, np.int64), np.empty(corridors, np.int64), np.zeros(2, np.int64)
        room = _Room(at, is_open, clock, new_ways(words), new_store(nodes, words))
        _kept.size, _kept.room = (nodes, words, corridors), room
    kept: _Room = _kept.room
    return kept


@lru_cache
def _budgets(limits: Limits, n_cells: int, words: int) -> tuple[int, np.ndarray]:
    """How many nodes to take room for at first, and `Work.limits`, of which each search needs a copy."""
    most_room = int(min(max(1, limits.megabytes * 2**20 / bytes_a_node(words)), MOST_ROOM))
    each = np.array([limits.seconds * 1e9, min(limits.nodes, 2**62), most_room, MOST_MOVES - 1], np.int64)
    return min(most_room, FIRST_ROOM + n_cells * n_cells // 4), each


def run(kernel: Callable[..., int], table: Table, boards: np.ndarray, targets: np.ndarray, limits: Limits) -> Found:
    """Search uint64[B, W] boards with int64[B] targets, slice by slice."""
    (n_cells, corridors, words), n = table.corridors.shape, len(boards)
    nodes, each = _budgets(limits, n_cells, words)
    at, is_open, clock, ways, store = _first_room(nodes, words, corridors)
    at[:] = 0
    found, moves = np.zeros((n, 6), np.int64), np.empty((n, 2 * MOST_MOVES), np.int32)
    work = Work(at, each.copy(), found, moves, is_open, clock, ways)
    given = (tuple(table), boards, targets, work[:-1], tuple(ways))
    while (outcome := kernel(*given, tuple(store))) != RUNNING:
        if outcome == FULL:
            began = time.thread_time_ns()
            try:
                store = grown(store, min(2 * len(store.board), int(each[MAX_ROOM])))
            except MemoryError:
                work.limits[MAX_ROOM] = 0
            at[SPENT_NS] += time.thread_time_ns() - began
        elif at[STARTED] == 0:
            store = _first_room(nodes, words, corridors).store  # A hard board's is long to clear.
    return Found(found, moves)
