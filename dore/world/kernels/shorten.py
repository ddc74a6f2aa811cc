"""Shortens a plan by replays. Boards are rows of uint64[W], moves int32[2M]: (pick, place) in turn."""

from __future__ import annotations

import numpy as np

from dore.world.kernels.compiling import entry, kernel
from dore.world.kernels.replay import BLOCKED, Fields, Sectors, approach, right_moves, stands

BOTH, SOONER, LATER = 0, 1, 2
"""Of an obstacle that is moved and later moved again: neither move is made, or one to where the second one puts it."""


@kernel
def moved_again(moves: np.ndarray, at: int, n_moves: int) -> int:
    """The next move of the obstacle that move `at` puts down; n_moves: there is none."""
    for later in range(at + 1, n_moves):
        if moves[2 * later] == moves[2 * at + 1]:
            return later
    return n_moves


@kernel
def leave_out(moves: np.ndarray, at: int, way: int, n_moves: int, fewer: np.ndarray) -> int:
    """Write the plan without move `at` into `fewer`; how many moves are left.

    Where the obstacle is moved again, `way` says what becomes of the two; where it is not, only BOTH changes the plan.
    """
    again, left = moved_again(moves, at, n_moves), 0
    if again == n_moves and way != BOTH:
        return n_moves
    made = at if way == SOONER else again if way == LATER else n_moves
    for step in range(n_moves):
        pick, place = moves[2 * step], moves[2 * step + 1]
        if step == made:
            pick, place = moves[2 * at], moves[2 * again + 1]
        elif step in (at, again):
            continue
        fewer[2 * left], fewer[2 * left + 1] = pick, place
        left += 1
    return left


@kernel
def solves(
    sectors: Sectors, target: int, moves: np.ndarray, first: int, n_moves: int, room: np.ndarray, found: np.ndarray
) -> bool:
    """Whether the moves from `first` are right, and the target is accessible after them."""
    right = right_moves(sectors, target, moves, first, n_moves, room, found)
    return right == n_moves and approach(sectors, room[n_moves], target) != BLOCKED


@kernel
def put(moves: np.ndarray, at: int, again: int, n_moves: int, cell: int) -> None:
    """Let move `at` put its obstacle on a cell, and its next move, `again`, pick it up there."""
    moves[2 * at + 1] = cell
    if again < n_moves:
        moves[2 * again] = cell


@kernel
def solves_elsewhere(
    sectors: Sectors,
    target: int,
    moves: np.ndarray,
    first: int,
    n_moves: int,
    room: np.ndarray,
    found: np.ndarray,
    replays: np.ndarray,
) -> bool:
    """Put one obstacle of a plan that solves nothing on another cell, such that it does; whether there is such a cell.

    Moves before `first` stay as they are, and room[first] is the board after them. replays: int64[1], how many there
    may be.
    """
    broken = right_moves(sectors, target, moves, first, n_moves, room, found)
    # A change after the first wrong move cannot mend it. From the last one, since replays overwrite the boards after.
    for at in range(min(broken, n_moves - 1), first - 1, -1):
        again, before = moved_again(moves, at, n_moves), moves[2 * at + 1]
        for cell in range(len(sectors.allowed)):
            if cell == before or stands(room[at], cell):
                continue
            put(moves, at, again, n_moves, cell)
            replays[0] -= 1
            if solves(sectors, target, moves, at, n_moves, room, found):
                return True
        put(moves, at, again, n_moves, before)
        if replays[0] <= 0:
            break
    return False


@kernel
def solves_with_two_elsewhere(
    sectors: Sectors,
    target: int,
    moves: np.ndarray,
    n_moves: int,
    room: np.ndarray,
    found: np.ndarray,
    replays: np.ndarray,
) -> bool:
    """The same with two obstacles, or with one that is put down twice."""
    broken = right_moves(sectors, target, moves, 0, n_moves, room, found)
    for at in range(min(broken, n_moves - 2), -1, -1):
        again, before = moved_again(moves, at, n_moves), moves[2 * at + 1]
        for cell in range(len(sectors.allowed)):
            if cell == before or stands(room[at], cell):
                continue
            put(moves, at, again, n_moves, cell)
            if right_moves(sectors, target, moves, at, at + 1, room, found) == at:
                continue
            if solves_elsewhere(sectors, target, moves, at + 1, n_moves, room, found, replays):
                return True
            if replays[0] <= 0:
                break
        put(moves, at, again, n_moves, before)
    return False


@kernel
def shorter(
    sectors: Sectors,
    target: int,
    moves: np.ndarray,
    n_moves: int,
    elsewhere: int,
    fewer: np.ndarray,
    room: np.ndarray,
    found: np.ndarray,
    replays: np.ndarray,
) -> int:
    """Write a plan of fewer moves that still solves into `fewer`; how many it has; n_moves: none was found.

    elsewhere: how many obstacles are put on another cell for it, 0 to 2.
    """
    for at in range(n_moves - 1, -1, -1):
        for way in range(3):
            left = leave_out(moves, at, way, n_moves, fewer)
            if left == n_moves or replays[0] <= 0:
                continue
            if elsewhere == 0:
                right = solves(sectors, target, fewer, 0, left, room, found)
            elif elsewhere == 1:
                right = solves_elsewhere(sectors, target, fewer, 0, left, room, found, replays)
            else:
                right = solves_with_two_elsewhere(sectors, target, fewer, left, room, found, replays)
            if right:
                return left
    return n_moves


@entry
def shorten(
    histogram: Fields,
    board: np.ndarray,
    target: int,
    moves: np.ndarray,
    n_moves: int,
    fewer: np.ndarray,
    room: np.ndarray,
    found: np.ndarray,
    replays: np.ndarray,
) -> int:
    """Shorten the plan of uint64[W] in place, until no replay finds a shorter one; how many moves are left.

    fewer: int32[2M]. room: uint64[M + 1, W]. found: int16[2M + 1]. replays: int64[1], how many there may be with
    obstacles on other cells.
    """
    sectors = Sectors(*histogram)
    for w in range(len(board)):
        room[0, w] = board[w]
    elsewhere = 0
    while n_moves and elsewhere <= 2:
        left = shorter(sectors, target, moves, n_moves, elsewhere, fewer, room, found, replays)
        if left == n_moves:
            elsewhere += 1
            continue
        for k in range(2 * left):
            moves[k] = fewer[k]
        n_moves, elsewhere = left, 0
    return n_moves
