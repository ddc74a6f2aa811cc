"""How far the target seems from accessible, and what changing a cell would do: see `dore.learn.corridor_features`.

Costs are small whole numbers, int16[4, G] a board: if the cell were changed; obstacles on the target's best corridor,
if it were; obstacles on the cell's own best corridor; and now, the same for each cell. A cell without a corridor counts
as one whose corridor is the whole board.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dore.world.kernels.bits import Board, bit, both, count, first, has, meets, minus, rest, row, some, union
from dore.world.kernels.compiling import entry, kernel
from dore.world.kernels.rules import accessible_of
from dore.world.kernels.tables import Table

SPARE = 2
"""Approach corridors of the target with more obstacles than this above the fewest are ignored."""
NEVER = 50
"""An infinite cost: a cap above every cost that matters."""
LEVELS = 5
"""Planes of a one-hot cost, one for each whole number; the last stands for more, too."""
N_PLANES = 4 * LEVELS + 2

CHANGED, BLOCKING, DEPTH, NOW = range(4)


class Scratch(NamedTuple):
    """Room for one board's costs. change ... begin_changed: int16[G]. ways: int64[2, D]. costs: int16[4, G].

    change: what changing a cell does to the ways that it lies on. total: what blocks the hand from the obstacles on a
    corridor of the target, if the cell were changed; begin: the same of the first of them to move.
    changed, first_changed: the same of one obstacle, and of it as the first. ways: what each of its corridors costs.
    """

    change: np.ndarray
    total: np.ndarray
    begin: np.ndarray
    changed: np.ndarray
    first_changed: np.ndarray
    ways: np.ndarray
    costs: np.ndarray


def new_scratch(table: Table) -> Scratch:
    """Room for one call at a time."""
    n_cells, most = table.corridors.shape[:2]
    change, total, begin, changed, first_changed = np.empty((5, n_cells), np.int16)
    costs = np.empty((4, n_cells), np.int16)
    return Scratch(change, total, begin, changed, first_changed, np.empty((2, most), np.int64), costs)


@kernel
def as_number(board: Board, cell: int) -> int:
    """1 where a cell is set, else 0."""
    return 1 if has(board, cell) else 0


@kernel
def fewest_on(table: Table, board: Board, cell: int) -> int:
    """Obstacles on a cell's best corridor."""
    fewest = 64 * len(board)
    for d in range(max(table.n_corridors[cell], 1)):
        fewest = min(fewest, count(both(row(table.corridors[cell, d], board), board)))
    return fewest


@kernel
def ways_to(
    table: Table, others: Board, blocked: Board, target: Board, corridor: Board, wanted: Board, cell: int, room: Scratch
) -> tuple[int, int, Board]:
    """What each way to an obstacle on a corridor of the target costs, into `room.ways`: as any, and as the first.

    An obstacle on a way counts twice if it is not accessible itself; those of the corridor itself do not count. The
    first to move needs a way on which none of the other wanted ones stands.
    Returns the least of both, and the cells that lie on any way.
    """
    cheapest, first_cheapest, on_ways = NEVER, NEVER, minus(others, others)
    for d in range(max(table.n_corridors[cell], 1)):
        way = row(table.corridors[cell, d], others)
        beside = minus(way, corridor)
        on_ways = union(on_ways, beside)
        cost = NEVER if meets(way, target) else count(both(beside, others)) + count(both(beside, blocked))
        room.ways[0, d], room.ways[1, d] = cost, NEVER if meets(way, wanted) else cost
        cheapest, first_cheapest = min(cheapest, cost), min(first_cheapest, room.ways[1, d])
    return cheapest, first_cheapest, on_ways


@kernel
def add_ways(table: Table, on_ways: Board, cell: int, cheapest: int, first_cheapest: int, room: Scratch) -> None:
    """Add what the hand needs to get to an obstacle, if any one cell were changed, to `room.total` and `room.begin`."""
    room.changed[:] = cheapest
    room.first_changed[:] = first_cheapest
    while some(on_ways):  # A change of any other cell does nothing to it.
        c = first(on_ways)
        on_ways = rest(on_ways)
        least, first_least = NEVER, NEVER
        for d in range(max(table.n_corridors[cell], 1)):
            change = room.change[c] if has(row(table.corridors[cell, d], on_ways), c) else 0
            least, first_least = min(least, room.ways[0, d] + change), min(first_least, room.ways[1, d] + change)
        room.changed[c], room.first_changed[c] = least, first_least
    room.changed[cell] = room.first_changed[cell] = 0
    for c in range(len(room.total)):
        room.total[c] += max(room.changed[c], 0)
        room.begin[c] = min(room.begin[c], max(room.first_changed[c], 0))


@kernel
def clear_corridor(table: Table, board: Board, target: Board, corridor: Board, room: Scratch, costs: np.ndarray) -> int:
    """Fold what one corridor of the target costs, if each cell were changed, into `costs`; what it costs now."""
    n_cells, blocking = len(room.total), count(both(corridor, board))
    wanted, others = both(board, corridor), minus(board, corridor)
    blocked = minus(others, accessible_of(table, union(others, target), others))
    begin = NEVER if some(wanted) else 0
    for c in range(n_cells):
        beside = 1 - as_number(corridor, c)
        room.change[c] = beside * (1 - 2 * as_number(board, c) - as_number(blocked, c))
        room.total[c], room.begin[c] = 0, begin
    extra, cells = 0, wanted
    while some(cells):
        cell = first(cells)
        cells = rest(cells)
        cheapest, first_cheapest, on_ways = ways_to(table, others, blocked, target, corridor, wanted, cell, room)
        add_ways(table, on_ways, cell, cheapest, first_cheapest, room)
        extra += cheapest
        begin = min(begin, first_cheapest)
    for c in range(n_cells):
        counted = blocking + as_number(corridor, c) * (1 - 2 * as_number(board, c))
        more = min(max(room.total[c], room.begin[c]), NEVER)
        costs[CHANGED, c] = min(costs[CHANGED, c], counted + more)
        costs[BLOCKING, c] = min(costs[BLOCKING, c], counted)
    return min(blocking + min(max(extra, begin), NEVER), NEVER)


@kernel
def costs_of(table: Table, board: Board, target: int, room: Scratch, costs: np.ndarray) -> None:
    """Fill int16[4, G] costs."""
    target_bit = bit(target, board)
    fewest, now = fewest_on(table, board, target), NEVER
    costs[:] = NEVER
    for d in range(max(table.n_corridors[target], 1)):
        corridor = row(table.corridors[target, d], board)
        if count(both(corridor, board)) <= fewest + SPARE:
            now = min(now, clear_corridor(table, board, target_bit, corridor, room, costs))
    for c in range(len(room.total)):
        costs[DEPTH, c] = fewest_on(table, union(board, target_bit), c)
        costs[NOW, c] = now


@kernel
def mark(planes: np.ndarray, group: int, level: int, cell: int) -> None:
    """Set the plane of a level, the nearest there is, in float32[N_PLANES, G]."""
    planes[LEVELS * group + min(max(level, 0), LEVELS - 1), cell] = 1.0


@entry
def corridor_costs(table: Table, boards: np.ndarray, targets: np.ndarray, room: Scratch, out: np.ndarray) -> None:
    """int16[B, 4, G] costs of uint64[B, W] boards and int64[B] targets."""
    for i in range(len(boards)):
        costs_of(table, row(boards[i], table.full), targets[i], room, out[i])


@entry
def corridor_planes(
    table: Table, boards: np.ndarray, targets: np.ndarray, where: np.ndarray, room: Scratch, out: np.ndarray
) -> None:
    """float32[B, N_PLANES, G]: the costs one-hot, and where the cells are; where: float32[2, G]."""
    out[:] = 0.0
    for i in range(len(boards)):
        costs_of(table, row(boards[i], table.full), targets[i], room, room.costs)
        costs, lowest = room.costs, NEVER
        for c in range(costs.shape[1]):
            lowest = min(lowest, costs[BLOCKING, c])
        for c in range(costs.shape[1]):
            # A change moves a cost by a few: one better is the first level, as good as now the second.
            mark(out[i], CHANGED, costs[CHANGED, c] - costs[NOW, c] + 1, c)
            mark(out[i], BLOCKING, costs[BLOCKING, c] - lowest, c)
            mark(out[i], DEPTH, costs[DEPTH, c], c)
            mark(out[i], NOW, costs[NOW, c], c)
            out[i, 4 * LEVELS, c], out[i, 4 * LEVELS + 1, c] = where[0, c], where[1, c]
