"""What the hand can get to on a board; the rules of `dore.world.rules`, one board at a time."""

from __future__ import annotations

from dore.world.kernels.bits import Board, bit, first, meets, minus, nothing, rest, row, some, union
from dore.world.kernels.compiling import kernel
from dore.world.kernels.tables import Table


@kernel
def accessible(table: Table, standing: Board, cell: int) -> bool:
    """Whether one of a cell's corridors is free. A corridor's cells never hold the cell itself."""
    for d in range(table.n_corridors[cell]):
        if not meets(row(table.corridors[cell, d], standing), standing):
            return True
    return False


@kernel
def accessible_of(table: Table, standing: Board, cells: Board) -> Board:
    """Those of `cells` that are accessible."""
    found = nothing(cells)
    while some(cells):
        cell = first(cells)
        cells = rest(cells)
        if accessible(table, standing, cell):
            found = union(found, bit(cell, found))
    return found


@kernel
def peeled(table: Table, board: Board, target: Board, among: Board) -> Board:
    """What is left when obstacles of `among` vanish as they become accessible, until none is; target: a board."""
    went = True
    while went:
        went = False
        left = among
        while some(left):
            cell = first(left)
            left = rest(left)
            if accessible(table, union(board, target), cell):
                here = bit(cell, board)
                board, among, went = minus(board, here), minus(among, here), True
    return board
