"""Replays plans. It shares neither rules nor table with the searches: each sector of the histogram is looked at.

Boards are rows of uint64[W] here, whatever W is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dore.world.kernels.compiling import entry, kernel

Fields = tuple[np.ndarray, ...]
"""Those of `Sectors`, as a plain tuple: a named one would take numba longer to pass."""
ONE, ZERO = np.uint64(1), np.uint64(0)
BLOCKED = -1
"""In place of a sector: none is free, or the replay ended before."""


class Sectors(NamedTuple):
    """The histogram of each cell: S sectors, blocked by sets of cells or ruled out beforehand.

    blockers: uint64[G, S, W]. allowed: bool[G, S]. order: int64[S], the sectors, those nearest 0 degrees first.
    """

    blockers: np.ndarray
    allowed: np.ndarray
    order: np.ndarray


@kernel
def stands(board: np.ndarray, cell: int) -> bool:
    """Whether something stands on a cell."""
    return board[cell >> 6] >> np.uint64(cell & 63) & ONE != ZERO


@kernel
def change(board: np.ndarray, cell: int) -> None:
    """Put something on a cell, or take it off."""
    board[cell >> 6] ^= ONE << np.uint64(cell & 63)


@kernel
def approach(sectors: Sectors, board: np.ndarray, cell: int) -> int:
    """The free sector nearest 0 degrees, or BLOCKED."""
    for sector in sectors.order:
        if sectors.allowed[cell, sector]:
            met = ZERO
            for w in range(len(board)):
                met |= board[w] & sectors.blockers[cell, sector, w]
            if met == ZERO:
                return sector
    return BLOCKED


@kernel
def move(sectors: Sectors, board: np.ndarray, target: int, pick: int, place: int, found: np.ndarray) -> bool:
    """Make one move on a board, with its two sectors into int16[2]; whether the rules allow it."""
    n_cells = len(sectors.allowed)
    if pick < 0 or pick >= n_cells or not stands(board, pick):
        return False
    change(board, pick)
    change(board, target)
    found[0] = approach(sectors, board, pick)
    if found[0] == BLOCKED or place < 0 or place >= n_cells or stands(board, place):
        return False
    found[1] = approach(sectors, board, place)
    change(board, target)
    change(board, place)
    return found[1] != BLOCKED


@kernel
def is_new(boards: np.ndarray, last: int) -> bool:
    """Whether the last board differs from all before it."""
    for earlier in range(last):
        differ = ZERO
        for w in range(boards.shape[1]):
            differ |= boards[earlier, w] ^ boards[last, w]
        if differ == ZERO:
            return False
    return True


@kernel
def right_moves(
    sectors: Sectors, target: int, moves: np.ndarray, first: int, n_moves: int, room: np.ndarray, found: np.ndarray
) -> int:
    """How many of n_moves int32[2M] moves are right before the first that is not; those before `first` are known to be.

    room[first] is the board before that move, room[:first] the ones before it; the boards after it are written there.
    """
    for step in range(first, n_moves):
        for w in range(room.shape[1]):
            room[step + 1, w] = room[step, w]
        pick, place = moves[2 * step], moves[2 * step + 1]
        if not move(sectors, room[step + 1], target, pick, place, found[2 * step :]) or not is_new(room, step + 1):
            return step
    return n_moves


@kernel
def replay_one(
    sectors: Sectors, target: int, moves: np.ndarray, n_moves: int, solved: bool, room: np.ndarray, found: np.ndarray
) -> bool:
    """Replay int32[2M] moves from the board in room[0], with the sectors into int16[2M + 1]; whether all is right."""
    if stands(room[0], target) or right_moves(sectors, target, moves, 0, n_moves, room, found) < n_moves:
        return False
    if solved:
        found[2 * n_moves] = approach(sectors, room[n_moves], target)
    return not solved or found[2 * n_moves] != BLOCKED


@entry
def replay(
    histogram: Fields,
    boards: np.ndarray,
    targets: np.ndarray,
    moves: np.ndarray,
    n_moves: np.ndarray,
    solved: np.ndarray,
    room: np.ndarray,
    found: np.ndarray,
) -> int:
    """Replay plans, from uint64[B, W] boards with int64[B] targets, up to the first that breaks a rule.

    moves: int32[B, 2M], (pick, place) in turn. n_moves: int64[B], at most M. solved: bool[B], whether the target must
    be accessible in the end. room: uint64[M + 1, W]. found: int16[B, 2M + 1], the sectors of the moves and of the
    target; BLOCKED where there are none. Returns how many plans are right before it; B: all of them.
    """
    sectors = Sectors(*histogram)
    for i in range(len(boards)):
        for w in range(boards.shape[1]):
            room[0, w] = boards[i, w]
        found[i, :] = BLOCKED
        if not replay_one(sectors, targets[i], moves[i], n_moves[i], solved[i], room, found[i]):
            return i
    return len(boards)
