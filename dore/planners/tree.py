"""The tree of a search by PUCT: its nodes, selection and backup. E denotes the moves of a node."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from dore.planners.base import RawPlan
from dore.world.plan import Status


class Leaf(NamedTuple):
    """A new board, evaluated. moves: Int64[E, 2]; priors: Float32[E]; value: of the board; opening: a winning move."""

    moves: np.ndarray
    priors: np.ndarray
    value: float
    opening: tuple[int, int] | None


@dataclass
class Node:
    """A board of the tree, and its moves. alive: those that may still lead to a board that is not in the tree."""

    board: int
    leaf: Leaf
    visits: np.ndarray
    totals: np.ndarray
    alive: np.ndarray
    children: dict[int, Node] = field(default_factory=dict)

    @classmethod
    def of(cls, board: int, leaf: Leaf) -> Node:
        n = len(leaf.moves)
        return cls(board, leaf, np.zeros(n, np.int32), np.zeros(n, np.float32), np.ones(n, bool))

    def best(self, c_puct: float) -> int:
        """The move of the largest PUCT score; one that was not tried counts as the board itself."""
        seen = self.visits > 0
        means = np.where(seen, self.totals / np.maximum(self.visits, 1), self.leaf.value)
        spread = self.leaf.priors * math.sqrt(1 + int(self.visits.sum())) / (1 + self.visits)
        return int(np.where(self.alive, means + c_puct * spread, -np.inf).argmax())


Path = list[tuple[Node, int]]
"""Nodes from the root on, and the move that is made at each."""


@dataclass
class Tree:
    """The search of one instance. seen: boards of the tree, each of which is in it once, reached by its first way."""

    start: int
    seen: set[int]
    root: Node | None = None
    path: Path = field(default_factory=list)
    plan: list[tuple[int, int]] | None = None
    over: bool = False
    reason: str = ""
    exhausted: bool = False
    expansions: int = 0
    wall_s: float = 0.0
    cpu_s: float = 0.0

    def select(self, c_puct: float) -> int | None:
        """Walk to a board that is not in the tree; None where there is none left."""
        while self.root is not None:
            self.path, node = [], self.root
            while True:
                if not node.alive.any():
                    break
                edge = node.best(c_puct)
                self.path.append((node, edge))
                if edge not in node.children:
                    pick, place = node.leaf.moves[edge].tolist()
                    board = node.board & ~(1 << pick) | 1 << place
                    if board not in self.seen:
                        return board
                    break
                node = node.children[edge]
            if not self.path:
                return None
            parent, edge = self.path[-1]
            parent.alive[edge] = False
        return self.start

    def grow(self, board: int, leaf: Leaf, gamma: float) -> None:
        """Put a board in, and back its value up to the nodes before it."""
        self.expansions += 1
        self.seen.add(board)
        if leaf.opening is not None:
            made = [node.leaf.moves[edge].tolist() for node, edge in self.path]
            self.plan = [*((pick, place) for pick, place in made), leaf.opening]
            return
        node = Node.of(board, leaf)
        if not self.path:
            self.root = node
        else:
            parent, edge = self.path[-1]
            parent.children[edge] = node
        value = leaf.value
        for before, edge in reversed(self.path):
            value *= gamma
            before.visits[edge] += 1
            before.totals[edge] += value

    def raw_plan(self) -> RawPlan:
        """The result as a raw plan."""
        if self.plan is not None:
            return RawPlan(self.plan, Status.SOLVED, self.wall_s, self.expansions)
        status = Status.UNSOLVABLE if self.exhausted else Status.GAVE_UP
        return RawPlan([], status, self.wall_s, self.expansions, reason=self.reason)


def number_of(words: list[int]) -> int:
    """A board's words as one number, bit c for cell c."""
    return sum((word & (1 << 64) - 1) << 64 * place for place, word in enumerate(words))


def words_of(board: int, n_words: int) -> list[int]:
    """The inverse, words signed as in Int64."""
    words = [board >> 64 * place & (1 << 64) - 1 for place in range(n_words)]
    return [word - (1 << 64) if word >> 63 else word for word in words]
