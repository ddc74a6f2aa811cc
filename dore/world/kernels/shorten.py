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
def solves_elsewhere(
    sectors: Sectors, target: int, moves: np.ndarray, n_moves: int, room: np.ndarray, found: np.ndarray
) -> bool:
    """Put one obstacle of a plan that solves nothing on another cell, such that it does; whether there is such a cell.

    Where the obstacle is moved again, it is picked up there.
    """
    broken = right_moves(sectors, target, moves, 0, n_moves, room, found)
    # A change after the first wrong move cannot mend it. From the last one, since replays overwrite the boards after.
    for at in range(min(broken, n_moves - 1), -1, -1):
        again, before = moved_again(moves, at, n_moves), moves[2 * at + 1]
        for cell in range(len(sectors.allowed)):
            if cell == before or stands(room[at], cell):
                continue
            moves[2 * at + 1] = cell
            if again < n_moves:
                moves[2 * again] = cell
            if solves(sectors, target, moves, at, n_moves, room, found):
                return True
        moves[2 * at + 1] = before
        if again < n_moves:
            moves[2 * again] = before
    return False


@kernel
def shorter(
    sectors: Sectors,
    target: int,
    moves: np.ndarray,
    n_moves: int,
    elsewhere: bool,
    fewer: np.ndarray,
    room: np.ndarray,
    found: np.ndarray,
) -> int:
    """Write a plan of fewer moves that still solves into `fewer`; how many it has; n_moves: none was found.

    elsewhere: whether one obstacle may be put on another cell for it.
    """
    for at in range(n_moves - 1, -1, -1):
        for way in range(3):
            left = leave_out(moves, at, way, n_moves, fewer)
            if left == n_moves:
                continue
            if solves(sectors, target, fewer, 0, left, room, found):
                return left
            if elsewhere and solves_elsewhere(sectors, target, fewer, left, room, found):
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
) -> int:
    """Shorten the plan of uint64[W] in place, until no replay finds a shorter one; how many moves are left.

    fewer: int32[2M]. room: uint64[M + 1, W]. found: int16[2M + 1].
    """
    sectors = Sectors(*histogram)
    for w in range(len(board)):
        room[0, w] = board[w]
    elsewhere = False
    while n_moves:
        left = shorter(sectors, target, moves, n_moves, elsewhere, fewer, room, found)
        if left < n_moves:
            for k in range(2 * left):
                moves[k] = fewer[k]
            n_moves, elsewhere = left, False
        elif elsewhere:
            break
        else:
            elsewhere = True
    return n_moves
