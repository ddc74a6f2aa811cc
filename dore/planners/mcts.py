"""Monte-Carlo tree search over boards, by PUCT, with a network's priors or uniform ones.

P denotes pairs of a board and a pick, G the cells.
"""

from __future__ import annotations

import os
import time

import numpy as np
import torch

from dore.errors import InputError, number, shown, whole
from dore.learn.corridor_features import corridor_costs
from dore.planners.base import EXHAUSTED, Planner, RawPlan
from dore.planners.policy import opening_places
from dore.planners.tree import Leaf, Tree, number_of, words_of
from dore.world.board import unpack
from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.rules import accessibility, lift, retrievable

PRIORS = ("network", "uniform")


class Mcts(Planner):
    """Tree search by PUCT (Silver and others, 2017) until a plan is found.

    A step goes down the tree by PUCT to a board that is not in it, generates its moves, and tests whether one of
    them makes the target accessible; the first plan that is found is the answer. The masks are those of all planners.
    A board that is in the tree already is not put in twice, so a tree in which nothing is left proves that there is no
    plan. Trees of several instances grow together, so that a network sees their boards at once.

    Args:
        priors: network: softmax of the Q-values of a board's moves, its value their largest; uniform: the same for
            all moves, and gamma to the power of the corridors' cost as the value.
        model: a run directory or a model file, whose values must be Q-values; None: the one in the package that
            learned from rewards alone. Of no effect on uniform priors.
        c_puct: the weight of the priors against the values.
        temperature: of the softmax.
        gamma: what a value is worth one move earlier.
        max_nodes: gives up on an instance after this many expanded boards.
        max_seconds: gives up on an instance after this many CPU seconds of its own.

    Raises:
        InputError: what `Learned` raises, or a value outside its domain.
    """

    name = "mcts"
    group = 16  # A node takes some 17 bytes for each of its moves.

    def __init__(
        self,
        reach: Reach,
        priors: str,
        model: str | os.PathLike[str] | None,
        c_puct: float,
        temperature: float,
        gamma: float,
        max_nodes: int,
        max_seconds: float,
    ) -> None:
        self.reach = reach
        if priors not in PRIORS:
            raise InputError(f"planners.mcts.priors: got {shown(priors)}, want one of {', '.join(PRIORS)}")
        self.agent = None
        if priors == "network":
            from dore.learn.checkpoint import Q_NETWORK
            from dore.planners.learned import Learned  # TorchRL, which uniform priors do not need.

            self.agent = Learned(reach, Q_NETWORK if model is None else model, max_moves=1).agent
        self.c_puct = number("planners.mcts.c_puct", c_puct, above=0.0, at_most=1e3)
        self.temperature = number("planners.mcts.temperature", temperature, above=0.0, at_most=1e3)
        self.gamma = number("planners.mcts.gamma", gamma, above=0.0, at_most=1.0)
        self.max_nodes = whole("planners.mcts.max_nodes", max_nodes, 1)
        self.max_seconds = number("planners.mcts.max_seconds", max_seconds, above=0.0, at_most=1e7)

    @torch.no_grad()
    def raw_plans(self, batch: Batch) -> list[RawPlan]:
        """Grow all trees together, a board each at a time, until each has ended."""
        boards = [number_of(words) for words in batch.board.tolist()]
        trees = [Tree(board, set()) for board in boards]
        for tree, solved in zip(trees, retrievable(self.reach, *batch).tolist(), strict=True):
            if solved:
                tree.plan, tree.over = [], True
        while alive := [row for row, tree in enumerate(trees) if not tree.over]:
            began, cpu_began = time.perf_counter(), time.process_time()
            self._step(batch, trees, alive)
            wall, cpu = time.perf_counter() - began, time.process_time() - cpu_began
            for row in alive:
                tree = trees[row]
                tree.wall_s += wall / len(alive)
                tree.cpu_s += cpu / len(alive)
                self._judge(tree)
        return [tree.raw_plan() for tree in trees]

    def _step(self, batch: Batch, trees: list[Tree], alive: list[int]) -> None:
        found = [(row, trees[row].select(self.c_puct)) for row in alive]
        chosen = [(row, board) for row, board in found if board is not None]
        for row in {row for row, _ in found} - {row for row, _ in chosen}:
            trees[row].exhausted = True
        if not chosen:
            return
        words = [words_of(board, self.reach.n_words) for _, board in chosen]
        rows = torch.tensor([row for row, _ in chosen])
        leaves = self.leaves(Batch(torch.tensor(words).to(batch.board.device), batch.target[rows]))
        for (row, board), leaf in zip(chosen, leaves, strict=True):
            trees[row].grow(board, leaf, self.gamma)

    def _judge(self, tree: Tree) -> None:
        """Whether a search has ended, and why."""
        if tree.exhausted:
            tree.reason = EXHAUSTED.format(len(tree.seen))
        elif tree.plan is None and tree.expansions >= self.max_nodes:
            tree.reason = "node budget"
        elif tree.plan is None and tree.cpu_s >= self.max_seconds:
            tree.reason = "time budget"
        tree.over = tree.plan is not None or bool(tree.reason)

    def leaves(self, batch: Batch) -> list[Leaf]:
        """The moves of each board, with priors and a value."""
        board, target = batch
        row, cell = accessibility(self.reach, board, target).pick.nonzero(as_tuple=True)
        lifted = lift(board[row], cell)
        place = accessibility(self.reach, lifted, target[row]).place & ~unpack(board[row], self.reach.n_cells)
        opens = place & opening_places(self.reach, lifted, target[row])
        values = torch.zeros(place.shape)
        if self.agent is not None and len(row):
            values = self.agent.move_values(board[row], target[row], cell).cpu()
        pair, to = place.nonzero(as_tuple=True)
        moves = torch.stack([cell[pair], to], -1).cpu().numpy()
        now = corridor_costs(self.reach, board, target).now.tolist()
        of_move, wins = values[pair.cpu(), to.cpu()].float().numpy(), opens[pair, to].cpu().numpy()
        ends = torch.searchsorted(row[pair].contiguous(), torch.arange(len(board), device=row.device), right=True)
        found, first = [], 0
        for number_of_board, end in enumerate(ends.tolist()):
            part = slice(first, end)
            found.append(self._leaf(moves[part], of_move[part], wins[part], now[number_of_board]))
            first = end
        return found

    def _leaf(self, moves: np.ndarray, values: np.ndarray, wins: np.ndarray, now: int) -> Leaf:
        opening = (int(moves[wins.argmax(), 0]), int(moves[wins.argmax(), 1])) if wins.any() else None
        if not len(moves):
            return Leaf(moves, values, 0.0, None)
        priors = np.exp((values - values.max()) / self.temperature)
        value = self.gamma**now if self.agent is None else float(np.clip(values.max(), -1.0, 1.0))
        return Leaf(moves, (priors / priors.sum()).astype(np.float32), value, opening)
