"""Planners that play a policy, move by move, on many instances at once; they need no network.

B denotes the batch, G the cells, W the words of a board, P pairs of a board and a pick.
"""

from __future__ import annotations

import time
from abc import abstractmethod
from functools import partial

import torch
from torch import Tensor

from dore.errors import number, whole
from dore.learn.rollout import Rollout, greedy_rollout
from dore.planners.base import Planner, RawPlan
from dore.world.board import unpack
from dore.world.episode import MAX_MOVES, Episodes
from dore.world.generator import hashed
from dore.world.plan import Status
from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.rules import Failure, legal_places, lift


def raw_plan_of(rollout: Rollout, row: int, planning_s: float) -> RawPlan:
    """An episode as a raw plan."""
    moves, solved = rollout.moves(row), bool(rollout.solved[row])
    failure = Failure(int(rollout.failure[row]))
    reason = "" if solved else "move budget" if failure is Failure.NONE else failure.name.lower().replace("_", " ")
    status = Status.SOLVED if solved else Status.GAVE_UP
    return RawPlan(moves, status, planning_s, expansions=int(rollout.tried[row]), reason=reason)


class Policy(Planner):
    """Plays episodes, each from the start, until one reaches the target or the budget is spent.

    Choices depend on the instance, on the number of the episode and on the seed, and not on what else is in a batch.

    Args:
        max_moves: ends an episode after this many moves.
        max_nodes: begins no episode that could take an instance past this many expanded boards, one a move.
        max_seconds: begins no episode after this many CPU seconds of an instance.

    Raises:
        InputError: a number outside its domain.
    """

    group = 1024

    def __init__(self, reach: Reach, max_moves: int, max_nodes: int, max_seconds: float) -> None:
        self.reach, key = reach, f"planners.{self.name}"
        moves = whole(f"{key}.max_moves", max_moves, 1, at_most=MAX_MOVES)
        self.max_nodes = whole(f"{key}.max_nodes", max_nodes, 1)
        self.max_moves = min(moves, self.max_nodes)
        self.max_seconds = number(f"{key}.max_seconds", max_seconds, above=0.0, at_most=1e7)

    @abstractmethod
    def choose(self, episodes: Episodes, number: int) -> tuple[Tensor, Tensor]:
        """The Int64[B] (pick, place) cells that are chosen; number: of the episode, from 0."""

    def raw_plans(self, batch: Batch) -> list[RawPlan]:
        """Episodes of all that are not solved, again and again."""
        n, number_of_episode = len(batch.target), 0
        plans: list[RawPlan] = [RawPlan([], Status.GAVE_UP, 0.0) for _ in range(n)]
        cpu_s, alive = [0.0] * n, list(range(n))
        while alive:
            began, cpu_began = time.perf_counter(), time.process_time()
            rows = torch.tensor(alive, device=batch.target.device)
            part = Batch(batch.board[rows], batch.target[rows])
            choose = partial(self.choose, number=number_of_episode)
            rollout = greedy_rollout(choose, self.reach, part, self.max_moves)
            wall = (time.perf_counter() - began) / len(alive)
            cpu = (time.process_time() - cpu_began) / len(alive)
            going = []
            for place, row in enumerate(alive):
                before, cpu_s[row] = plans[row], cpu_s[row] + cpu
                plan = raw_plan_of(rollout, place, before.planning_s + wall)
                plans[row] = plan._replace(expansions=before.expansions + plan.expansions)
                if plan.status is not Status.SOLVED and self._may_go_on(plans[row], cpu_s[row], len(plan.moves)):
                    going.append(row)
            alive, number_of_episode = going, number_of_episode + 1
        return plans

    def _may_go_on(self, plan: RawPlan, cpu_s: float, moves: int) -> bool:
        """Whether another episode fits into the budget; after one without a move there is nothing to try."""
        return moves > 0 and plan.expansions + self.max_moves <= self.max_nodes and cpu_s < self.max_seconds


def chances(episodes: Episodes, seed: int, number: int, draw: int, n: int) -> Tensor:
    """Float64[B, n] in [0, 1): random numbers of an episode's instance, step, number and draw."""
    start, steps = episodes.visited[:, 0], episodes.steps[:, None]
    about = [steps, torch.full_like(steps, seed), torch.full_like(steps, number), torch.full_like(steps, draw)]
    words = torch.cat([start, episodes.target[:, None], *about], -1)
    each = torch.arange(n, device=words.device)[:, None].expand(n, 1)
    every = torch.cat([words[:, None].expand(-1, n, -1), each.expand(len(words), n, 1)], -1)
    return hashed(every.reshape(-1, every.shape[-1])).reshape(len(words), n)


def random_move(reach: Reach, episodes: Episodes, seed: int, number: int) -> tuple[Tensor, Tensor]:
    """A random legal pick of each episode, and a random legal place for it."""
    n = reach.n_cells
    pick = (chances(episodes, seed, number, 0, n) + 1).mul(episodes.legal.pick).argmax(-1)
    places = legal_places(reach, episodes.board, episodes.target, episodes.visited, pick)
    return pick, (chances(episodes, seed, number, 1, n) + 1).mul(places).argmax(-1)


def opening_places(reach: Reach, lifted: Tensor, target: Tensor) -> Tensor:
    """Bool[P, G]: cells on which a lifted obstacle leaves the target accessible, whether it may be put there or not."""
    corridors = reach.blocking_sets[:, target]
    free = (lifted & corridors).eq(0).all(-1) & reach.cell_accessible(lifted, target)
    opens = torch.zeros(len(target), reach.n_cells, dtype=torch.bool, device=lifted.device)
    for corridor, is_open in zip(corridors, free, strict=True):
        opens |= is_open[:, None] & ~unpack(corridor, reach.n_cells)
    return opens


def legal_pairs(reach: Reach, episodes: Episodes) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Every legal pick of B episodes: its row and cell Int64[P], the lifted board Int64[P, W], places Bool[P, G]."""
    row, pick = episodes.legal.pick.nonzero(as_tuple=True)
    board = episodes.board[row]
    places = legal_places(reach, board, episodes.target[row], episodes.visited[row], pick)
    return row, pick, lift(board, pick), places


def winning_else(reach: Reach, episodes: Episodes, other: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor]:
    """Int64[B] (pick, place): the first legal move that makes the target accessible, or `other` where there is none."""
    row, cell, lifted, places = legal_pairs(reach, episodes)
    pair, to = (places & opening_places(reach, lifted, episodes.target[row])).nonzero(as_tuple=True)
    at, (pick, place) = row[pair], (one.clone() for one in other)
    first = torch.ones_like(at, dtype=torch.bool)  # Of its episode; `at` ascends.
    first[1:] = at[1:] != at[:-1]
    pick[at[first]], place[at[first]] = cell[pair[first]], to[first]
    return pick, place
