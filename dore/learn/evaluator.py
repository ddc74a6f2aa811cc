"""The intermediate performance test (IPT) of Algorithm 2, lines 7-16."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import torch

from dore.errors import InputError, number, seed_of, whole
from dore.learn.rollout import Choose, greedy_rollout
from dore.world.episode import MAX_MOVES
from dore.world.instances import InstanceSet


@dataclass(frozen=True)
class TestResult:
    """success: share of the instances solved, over all batches. passed: every batch reached S_T.

    rearrangements: mean moves over the solved instances; None where none was solved. cost: mean moves over all
    instances, the step limit where one was not solved; the better of two models has the lower cost. by_world: the
    results of which this is the mean.
    """

    __test__ = False

    success: float
    passed: bool
    rearrangements: float | None
    cost: float
    by_world: Mapping[str, TestResult] = field(default_factory=dict)


def mean_of(results: Mapping[str, TestResult]) -> TestResult:
    """The mean over worlds, each counted alike; it passes where all of them pass."""
    each = list(results.values())
    moves = [result.rearrangements for result in each if result.rearrangements is not None]
    return TestResult(
        success=sum(result.success for result in each) / len(each),
        passed=all(result.passed for result in each),
        rearrangements=sum(moves) / len(moves) if moves else None,
        cost=sum(result.cost for result in each) / len(each),
        by_world=results,
    )


class PerformanceTest:
    """N_b batches of T_try instances, drawn from the validation split by a generator of its own.

    The test passes when every batch reaches S_T. The paper draws from its test set; ours stays unseen until the
    end.

    Args:
        instances: the validation split.
        n_batches: N_b.
        batch_size: T_try.
        target_success: S_T, a share in (0, 1].
        every_episodes: T_epo, episodes between two tests.
        max_moves: step limit of an episode.

    Raises:
        InputError: a count below 1, a share outside (0, 1], or fewer instances than a batch takes.
    """

    def __init__(
        self,
        instances: InstanceSet,
        n_batches: int,
        batch_size: int,
        target_success: float,
        every_episodes: int,
        max_moves: int,
        seed: int,
    ) -> None:
        self.instances = instances
        self.n_batches = whole("ipt.n_batches", n_batches, 1, at_most=10_000)
        self.batch_size = whole("ipt.batch_size", batch_size, 1)
        self.target_success = number("ipt.target_success", target_success, above=0.0, at_most=1.0)
        self.every_episodes = whole("ipt.every_episodes", every_episodes, 1)
        self.max_moves = whole("ipt.max_moves", max_moves, 1, at_most=MAX_MOVES)
        if batch_size > len(instances):
            raise InputError(f"ipt.batch_size: {batch_size} instances from a validation split of {len(instances)}")
        self.generator = torch.Generator().manual_seed(seed_of("ipt.seed", seed))

    def run(self, choose: Choose) -> TestResult:
        """Test the greedy policy."""
        solved = moves = 0
        passed = True
        for _ in range(self.n_batches):
            rows = torch.randperm(len(self.instances), generator=self.generator)[: self.batch_size]
            batch = self.instances.batch(rows.to(self.instances.board.device))
            rollout = greedy_rollout(choose, self.instances.reach, batch, self.max_moves)
            n_solved = int(rollout.solved.sum())
            solved += n_solved
            moves += int(rollout.n_moves[rollout.solved].sum())
            passed &= n_solved >= self.target_success * self.batch_size
        n = self.n_batches * self.batch_size
        cost = (moves + (n - solved) * self.max_moves) / n
        return TestResult(solved / n, passed, moves / solved if solved else None, cost)
