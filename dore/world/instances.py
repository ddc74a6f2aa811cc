"""Sets of problem instances, unique and checked, and the three splits of a run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from dore.errors import InputError, seed_of, whole
from dore.world.board import contains, count, unpack
from dore.world.generator import PATIENCE, Difficulty, FreshInstances, InstanceSource
from dore.world.problem import Batch, Problem, Scene
from dore.world.reach import Reach
from dore.world.rules import has_move, retrievable

MOST_INSTANCES = 2_000_000
"""No set is larger: it is drawn before anything starts. Table 5 has 70,000."""


def problems_of(reach: Reach, batch: Batch) -> list[Problem]:
    """The instances of a batch one by one."""
    return [
        Problem(Scene(reach.layout, tuple(cell for cell, taken in enumerate(row) if taken), target), reach)
        for row, target in zip(unpack(batch.board, reach.n_cells).tolist(), batch.target.tolist(), strict=True)
    ]


def random_problem(reach: Reach, difficulty: Difficulty, seed: int) -> Problem:
    """One instance of the test split.

    Raises:
        InputError: no instance is found.
    """
    (problem,) = problems_of(reach, FreshInstances(reach, difficulty, "test", seed).draw(1))
    return problem


class InstanceSet:
    """A fixed, unique set of instances of one reach.

    Raises:
        InputError: cells off the board, a target among the obstacles, or one that is accessible at the start.
    """

    def __init__(self, reach: Reach, board: Tensor, target: Tensor) -> None:
        if not isinstance(board, Tensor) or not isinstance(target, Tensor):
            raise InputError(
                f"instances: got {type(board).__name__} and {type(target).__name__}, want tensors of torch"
            )
        fits = target.ndim == 1 and board.shape == (len(target), reach.n_words)
        if not fits or board.dtype != torch.int64 or target.dtype != torch.int64:
            raise InputError(
                f"instances: got {board.dtype}{list(board.shape)} boards, {target.dtype}{list(target.shape)} targets, "
                f"want Int64[N, {reach.n_words}] and Int64[N]"
            )
        on_board = (target >= 0) & (target < reach.n_cells)
        cell = torch.where(on_board, target, 0)
        faults = {
            "an obstacle off the board": count(board) != unpack(board, reach.n_cells).sum(-1),
            "a target off the board": ~on_board,
            "the target among the obstacles": on_board & contains(board, cell),
            "nothing to rearrange": on_board & retrievable(reach, board, cell),
        }
        for why, broken in faults.items():
            if bool(broken.any()):
                raise InputError(f"instances: number {int(broken.nonzero()[0, 0]) + 1} has {why}")
        self.reach = reach
        self.board = board
        self.target = target

    def __len__(self) -> int:
        return len(self.target)

    def __iter__(self) -> Iterator[Problem]:
        return iter(problems_of(self.reach, self.batch()))

    def first(self, n: int) -> InstanceSet:
        """The first `n` instances.

        Raises:
            InputError: there are fewer.
        """
        whole("limit", n, 1, at_most=len(self))
        return InstanceSet(self.reach, *self.batch(slice(n)))

    def batch(self, rows: Tensor | slice = slice(None)) -> Batch:
        """The instances of those rows."""
        return Batch(self.board[rows], self.target[rows])

    @classmethod
    def generate(cls, reach: Reach, n: int, difficulty: Difficulty, split: str, seed: int) -> InstanceSet:
        """`n` different instances of a split.

        Raises:
            InputError: there are not that many.
        """
        whole("instances: how many", n, 1)
        fresh = FreshInstances(reach, difficulty, split, seed)
        found = torch.empty(0, reach.n_words + 1, dtype=torch.int64, device=reach.device)
        stale, draws = 0, 1
        while len(found) < n and stale < PATIENCE:
            drawn = [
                torch.cat([board, target[:, None]], -1) for board, target in (fresh.candidates() for _ in range(draws))
            ]
            longer = _first_of_each(torch.cat([found, *drawn]))
            # Twice as many each time, so that sorting them out takes time in proportion to their number.
            stale, draws = (stale + draws, 1) if len(longer) == len(found) else (0, 2 * draws)
            found = longer
        if len(found) < n:
            raise InputError(f"instances: asked for {n} different ones of the {split} split, there are {len(found)}")
        return cls(reach, found[:n, :-1].contiguous(), found[:n, -1].contiguous())


class FixedInstances(InstanceSource):
    """Draws from a set, with replacement, by a generator of its own.

    Raises:
        InputError: an instance without a legal first move, where no episode can start.
    """

    def __init__(self, instances: InstanceSet, seed: int) -> None:
        super().__init__(seed)
        stuck = ~has_move(instances.reach, instances.board, instances.target)
        if bool(stuck.any()):
            raise InputError(f"instances: number {int(stuck.nonzero()[0, 0]) + 1} has no legal first move")
        self.instances = instances

    def draw(self, n: int) -> Batch:
        """`n` instances of the set."""
        rows = torch.randint(len(self.instances), (n,), generator=self.generator)
        return self.instances.batch(rows.to(self.instances.board.device))


def _first_of_each(rows: Tensor) -> Tensor:
    """The different rows of Int64[N, K], each where it first stood."""
    if not len(rows):
        return rows
    _, group = rows.unique(dim=0, return_inverse=True)
    place = torch.arange(len(rows), device=rows.device)
    first = torch.full((int(group.max()) + 1,), len(rows), device=rows.device).scatter_reduce(0, group, place, "amin")
    return rows[first.sort().values]


@dataclass(frozen=True)
class InstanceSplits:
    """The three splits of one difficulty, by the board that an episode starts from.

    No board, nor its mirror image, starts episodes of two splits. Later on, an episode may stand on a board of another
    split.

    Args:
        min_obstacles, max_obstacles: see `dore.world.generator.Difficulty`.
        train_size: how many instances to train on; None draws new ones all the time.
        validation_size, test_size: how many instances these sets hold.
        seed: of the sets.

    Raises:
        InputError: a number outside its domain.
    """

    min_obstacles: int
    max_obstacles: int
    train_size: int | None
    validation_size: int
    test_size: int
    seed: int

    def __post_init__(self) -> None:
        Difficulty(self.min_obstacles, self.max_obstacles)
        for name in ("train_size", "validation_size", "test_size"):
            size = getattr(self, name)
            if name != "train_size" or size is not None:
                whole(f"instances.{name}", size, 1, at_most=MOST_INSTANCES)
        seed_of("instances.seed", self.seed)

    @property
    def difficulty(self) -> Difficulty:
        """How many obstacles there are."""
        return Difficulty(self.min_obstacles, self.max_obstacles)

    def train(self, reach: Reach, seed: int) -> InstanceSource:
        """Where training episodes come from; `seed` is the run's."""
        if self.train_size is None:
            return FreshInstances(reach, self.difficulty, "train", seed)
        instances = InstanceSet.generate(reach, self.train_size, self.difficulty, "train", self.seed)
        return FixedInstances(instances, seed)

    def validation(self, reach: Reach) -> InstanceSet:
        """What the IPT draws from."""
        return InstanceSet.generate(reach, self.validation_size, self.difficulty, "validation", self.seed)

    def test(self, reach: Reach) -> InstanceSet:
        """Used once, at the end."""
        return InstanceSet.generate(reach, self.test_size, self.difficulty, "test", self.seed)
