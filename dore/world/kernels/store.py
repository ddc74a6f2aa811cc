"""The boards that a search has seen, and those that are in line."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dore.world.kernels.bits import Board, Word, first, hashed, minus, row, same, write
from dore.world.kernels.compiling import kernel

MOST_MOVES = 256
"""The longest plan that is looked for."""
NOWHERE = 1 << 20
"""No cell."""
NOBODY = MOST_MOVES + 1
"""The budget of nobody in line."""

PARENT, MOVES, DONE, PLACED = range(4)
NODES, UNUSED, ENTRIES, UNHASHED = range(4)


class Store(NamedTuple):
    """Room for N boards, the nodes of the search. Kernels never enlarge it: `grown` does, between two calls.

    board: uint64[N, W].
    about: int32[N, 4], of each: the node it was reached from, -1 for the start; the fewest moves known to it; the
        largest budget it was expanded with; where its last obstacle was put.
    slot: int32[S], open addressing: node + 1, or 0 where none is; S is a power of two.
    line: int32[2N, 2], entries in line: a node, and the entry below it, -1 for none.
    head: int32[2, MOST_MOVES + 2], the top entry for this excess and the next, by budget.
    size: int64[4]: how many nodes; the first of the entries that are free again, -1: none; entries ever used; nodes
        whose slot has yet to be set.
    """

    board: np.ndarray
    about: np.ndarray
    slot: np.ndarray
    line: np.ndarray
    head: np.ndarray
    size: np.ndarray


def new_store(room: int, words: int) -> Store:
    """Room for so many boards."""
    return Store(
        np.empty((room, words), np.uint64),
        np.empty((room, 4), np.int32),
        np.zeros(n_slots(room), np.int32),
        np.empty((2 * room, 2), np.int32),
        np.empty((2, MOST_MOVES + 2), np.int32),
        np.zeros(4, np.int64),
    )


def n_slots(room: int) -> int:
    """S: at least a third of the slots stay free."""
    return 1 << (room + room // 2 - 1).bit_length()


def bytes_a_node(words: int) -> int:
    """What a node takes at most, while the largest of the arrays grows by half too."""
    return 8 * words + 16 + 16 + 12 + max(8 * words, 16)


def grown(old: Store, room: int) -> Store:
    """The same boards with more room; the search sets their slots, which takes long where they are many.

    Raises:
        MemoryError: there is none.
    """

    def more(array: np.ndarray, length: int) -> np.ndarray:
        new = np.empty((length, array.shape[1]), array.dtype)
        new[: len(array)] = array
        return new

    slot = np.zeros(n_slots(room), np.int32)
    board, about, line = more(old.board, room), more(old.about, room), more(old.line, 2 * room)
    size = old.size.copy()
    size[UNHASHED] = size[NODES]
    return Store(board, about, slot, line, old.head.copy(), size)


@kernel
def home(store: Store, board: Board) -> int:
    """The slot where the search for a board begins."""
    return int(np.int64(hashed(board) >> Word(20))) & (len(store.slot) - 1)


@kernel
def clear(store: Store, like: Board) -> None:
    """Forget all boards; like: any board."""
    n_nodes, n_slots = store.size[NODES], len(store.slot)
    if n_nodes > n_slots >> 6:
        store.slot[:] = 0
        n_nodes = 0
    for node in range(n_nodes):  # Each lies in the row of taken slots that begins here.
        slot = home(store, row(store.board[node], like))
        while store.slot[slot] != 0:
            store.slot[slot] = 0
            slot = (slot + 1) & (n_slots - 1)
    store.head[:] = -1
    store.size[:] = 0
    store.size[UNUSED] = -1


@kernel
def slot_of(store: Store, board: Board) -> int:
    """The slot that holds a board, or the free one where it belongs."""
    mask, slot = len(store.slot) - 1, home(store, board)
    while store.slot[slot] != 0 and not same(store.board[store.slot[slot] - 1], board):
        slot = (slot + 1) & mask
    return slot


@kernel
def hash_some(store: Store, most: int, like: Board) -> None:
    """Set the slots of so many nodes after the store has grown; like: any board."""
    left = max(store.size[UNHASHED] - most, 0)
    for node in range(left, store.size[UNHASHED]):
        store.slot[slot_of(store, row(store.board[node], like))] = node + 1
    store.size[UNHASHED] = left


@kernel
def add(store: Store, board: Board, parent: int, moves: int, placed: int) -> int:
    """The node of a board that is new or reached by fewer moves than before; else -1."""
    slot = slot_of(store, board)
    node = store.slot[slot] - 1
    if node < 0:
        node = store.size[NODES]
        store.size[NODES] += 1
        store.slot[slot] = node + 1
        write(store.board[node], board)
    elif moves >= store.about[node, MOVES]:
        return -1
    about = store.about[node]
    about[PARENT], about[MOVES], about[DONE], about[PLACED] = parent, moves, 0, placed
    return node


@kernel
def queue(store: Store, later: int, budget: int, node: int) -> None:
    """Put a node in line, for this excess (later = 0) or the next (1)."""
    entry = store.size[UNUSED]
    if entry >= 0:
        store.size[UNUSED] = store.line[entry, 1]
    else:
        entry = store.size[ENTRIES]
        store.size[ENTRIES] += 1
    store.line[entry, 0] = node
    store.line[entry, 1] = store.head[later, budget]
    store.head[later, budget] = entry


@kernel
def unqueue(store: Store, budget: int) -> int:
    """Take the latest node of a budget out of line."""
    entry = store.head[0, budget]
    store.head[0, budget] = store.line[entry, 1]
    store.line[entry, 1] = store.size[UNUSED]
    store.size[UNUSED] = entry
    return store.line[entry, 0]


@kernel
def next_excess(store: Store, highest: int) -> int:
    """Go on with the next excess; the least budget in line up to the highest, or NOBODY."""
    least = NOBODY
    for budget in range(highest, -1, -1):
        store.head[0, budget], store.head[1, budget] = store.head[1, budget], -1
        if store.head[0, budget] >= 0:
            least = budget
    return least


@kernel
def report(store: Store, goal: int, like: Board, moves: np.ndarray) -> int:
    """Write the moves to a node into int32[2M], (pick, place) in turn; how many there are."""
    n_moves = store.about[goal, MOVES]
    for i in range(n_moves - 1, -1, -1):
        parent = store.about[goal, PARENT]
        after, before = row(store.board[goal], like), row(store.board[parent], like)
        moves[2 * i], moves[2 * i + 1] = first(minus(before, after)), first(minus(after, before))
        goal = parent
    return n_moves
