"""Sets of problem instances, unique and checked, and the three splits of a run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from dore.errors import InputError, seed_of, whole
from dore.world.board import check_boards, integers, refuse_first, unpack
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
    """A fixed set of different instances of one reach.

    Args:
        board: Int64[N, W], integers of NumPy and of other widths too; copied.
        target: Int64[N], likewise.
        accessible: whether a target may be accessible at the start, which leaves nothing to rearrange.

    Raises:
        InputError: cells off the board, a target among the obstacles or accessible at the start, or an instance twice.
    """

    def __init__(self, reach: Reach, board: Tensor, target: Tensor, accessible: bool = False) -> None:
        board, target = integers("instances", board, reach.device), integers("instances", target, reach.device)
        check_boards("instances", board, target, reach.n_cells)
        solved = retrievable(reach, board, target)
        self.n_accessible = int(solved.sum())
        """How many targets are accessible at the start."""
        faults = {
            "nothing to rearrange": solved & (not accessible),
            "the board and the target of an earlier one": _repeats(torch.cat([board, target[:, None]], -1)),
        }
        refuse_first("instances", faults)
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
        return InstanceSet(self.reach, *self.batch(slice(n)), accessible=self.n_accessible > 0)

    def batch(self, rows: Tensor | slice = slice(None)) -> Batch:
        """A copy of the instances of those rows."""
        return Batch(self.board[rows].clone(), self.target[rows].clone())

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
            longer = first_of_each(torch.cat([found, *drawn]))
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
        super().__init__(instances.reach, seed)
        stuck = ~has_move(instances.reach, instances.board, instances.target)
        refuse_first("instances", {"no legal first move": stuck})
        self.instances = instances

    def draw(self, n: int) -> Batch:
        """`n` instances of the set."""
        rows = torch.randint(len(self.instances), (n,), generator=self.generator)
        return self.instances.batch(rows.to(self.instances.board.device))


def first_of_each(rows: Tensor) -> Tensor:
    """The different rows of Int64[N, K], each where it first stood."""
    return rows[~_repeats(rows)]


def _repeats(rows: Tensor) -> Tensor:
    """Bool[N]: which of Int64[N, K] rows stand further up already."""
    repeats = torch.ones(len(rows), dtype=torch.bool, device=rows.device)
    if len(rows):
        _, group = rows.unique(dim=0, return_inverse=True)
        place = torch.arange(len(rows), device=rows.device)
        first = torch.full((int(group.max()) + 1,), len(rows), device=rows.device)
        repeats[first.scatter_reduce(0, group, place, "amin")] = False
    return repeats


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

    def most_obstacles(self, n_cells: int) -> int:
        """The most that an instance may have."""
        return self.max_obstacles

    def new(self, reach: Reach, split: str, seed: int) -> FreshInstances:
        """New instances of a split without end."""
        return FreshInstances(reach, self.difficulty, split, seed)

    def train(self, reach: Reach, seed: int) -> InstanceSource:
        """Where training episodes come from; `seed` is the run's."""
        if self.train_size is None:
            return self.new(reach, "train", seed)
        instances = InstanceSet.generate(reach, self.train_size, self.difficulty, "train", self.seed)
        return FixedInstances(instances, seed)

    def validation(self, reach: Reach) -> InstanceSet:
        """What the IPT draws from."""
        return InstanceSet.generate(reach, self.validation_size, self.difficulty, "validation", self.seed)

    def test(self, reach: Reach) -> InstanceSet:
        """Used once, at the end."""
        return InstanceSet.generate(reach, self.test_size, self.difficulty, "test", self.seed)
