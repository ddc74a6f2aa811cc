"""Algorithm 2: play, store, learn, test, until an IPT passes or the budget is spent."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

import torch

from dore.learn.budget import Budget, LinearEpsilon
from dore.learn.evaluator import TestResult, mean_of
from dore.learn.learner import Learner
from dore.learn.memory import memory_for
from dore.learn.player import Burst
from dore.learn.worlds import World

MAIN = "main"
"""The name of a run's first world, and of its only one where it has no other."""


class Diverged(RuntimeError):
    """The loss or a weight is no longer finite: names the step, the loss and the last good checkpoint."""


class StopReason(StrEnum):
    """Why a training run stopped."""

    PASSED = "passed"
    """The last IPT passed."""
    BUDGET = "budget"
    """Episodes, minutes or updates are spent."""
    INTERRUPTED = "interrupted"
    """Asked to stop; the run can be resumed from its checkpoint."""


@dataclass
class Progress:
    """Where a run is, over all of its worlds.

    filled: transitions stored before the first episode. success, rearrangements: of the last IPT; best: of the best
    one; loss: of the last updates.
    """

    iteration: int = 0
    filled: int = 0
    env_steps: int = 0
    episodes: int = 0
    updates: int = 0
    seconds: float = 0.0
    loss: float = math.nan
    epsilon: float = 1.0
    success: float | None = None
    rearrangements: float | None = None
    best_success: float = -1.0
    best_cost: float | None = None


Report = Callable[[Progress, TestResult | None], None]
"""Called after each iteration, with the IPT's result where one was run."""


class Trainer:
    """One learner, the worlds that it learns from in turn, and the loop.

    Args:
        learner: makes the updates.
        worlds: by name, at least one; all have the same IPT settings. The steps and episodes of all count alike.
        epsilon: the schedule of exploration, over the steps of all worlds.
        budget: see `Budget`; the worlds and the learner have the same one.
    """

    def __init__(self, learner: Learner, worlds: Mapping[str, World], epsilon: LinearEpsilon, budget: Budget) -> None:
        self.learner, self.worlds, self.epsilon, self.budget = learner, dict(worlds), epsilon, budget
        self._turns = list(self.worlds.values())
        evaluator = self._turns[0].evaluator
        self.test_every, self.target_success = evaluator.every_episodes, evaluator.target_success
        self.progress = Progress()

    def run(self, report: Report, stop: Callable[[], bool]) -> StopReason:
        """Train until the IPT passes, the budget is spent, or `stop` returns true.

        Raises:
            Diverged: the loss is NaN or infinite.
        """
        clock = time.process_time if self.budget.clock == "cpu" else time.perf_counter
        progress, before = self.progress, clock() - self.progress.seconds
        while not self.spent():
            tests_before = progress.episodes // self.test_every
            self.iterate()
            progress.seconds = clock() - before
            # Before the first update there is nothing to test.
            due = progress.updates > 0 and progress.episodes // self.test_every > tests_before
            tested = self.run_test() if due else None
            report(progress, tested)
            if tested is not None and tested.passed and progress.episodes >= self.budget.min_episodes:
                return StopReason.PASSED
            if stop() and not self.spent():
                return StopReason.INTERRUPTED
        return StopReason.BUDGET

    @property
    def to_fill(self) -> int:
        """How many transitions all replays are filled with before anything counts."""
        return self.budget.fill * len(self.worlds)

    def iterate(self) -> None:
        """One world's turn: a step of all its environments, and the updates due unless it fills its replay."""
        progress = self.progress
        world = self._turns[progress.iteration % len(self._turns)]
        progress.iteration += 1
        if world.filling:
            progress.filled += world.fill()
            return
        if not world.has_left:
            progress.epsilon = self.epsilon(progress.env_steps)
        self.learner.set_rate(self._share_spent())
        burst = world.play(progress.epsilon, self._next_stop() - progress.episodes)
        progress.env_steps = sum(one.env_steps for one in self._turns)
        if len(burst.stored):
            self._learn(world, burst)
            progress.episodes += int(burst.episodes[-1])

    def run_test(self) -> TestResult:
        """An IPT of the greedy policy in every world, with the mean weights where they are kept; the mean of all."""
        with self.learner.averaged.acting():
            tested = mean_of({name: world.test() for name, world in self.worlds.items()})
        self.progress.success, self.progress.rearrangements = tested.success, tested.rearrangements
        return tested

    def spent(self) -> bool:
        """Whether the episodes, minutes or updates are used up."""
        return self._share_spent() >= 1.0

    def _share_spent(self) -> float:
        """The share that is used up of what is used up most, at most 1."""
        return min(1.0, max(self._shares_spent().values()))

    def _shares_spent(self) -> dict[str, float]:
        """The share of the episodes that is used up, and those of the minutes and updates where they are limited."""
        progress, budget = self.progress, self.budget
        shares = {"max_episodes": progress.episodes / budget.max_episodes}
        if budget.max_minutes is not None:
            shares["max_minutes"] = progress.seconds / (60 * budget.max_minutes)
        if budget.max_updates is not None:
            shares["max_updates"] = progress.updates / budget.max_updates
        return shares

    @property
    def nearest_limit(self) -> str:
        """The key of the limit of which the largest share is used up."""
        shares = self._shares_spent()
        return max(reversed(shares), key=shares.__getitem__)

    def way_to_end(self) -> tuple[float, float, str]:
        """How far the run is on the way to what can end it next, how far that is, and in which unit.

        That is the end of its minutes or updates if it has limited ones, else the next IPT that it can pass, or its
        last episode.
        """
        progress, budget = self.progress, self.budget
        if self.nearest_limit == "max_minutes":
            minutes = float(budget.max_minutes or 0.0)
            return min(round(progress.seconds / 60, 2), minutes), minutes, "min"
        if self.nearest_limit == "max_updates":
            updates = budget.max_updates or 0
            return min(progress.updates, updates), updates, "updates"
        tests = max(progress.episodes // self.test_every + 1, math.ceil(budget.min_episodes / self.test_every))
        return progress.episodes, min(tests * self.test_every, budget.max_episodes), "ep"

    def _next_stop(self) -> int:
        """The number of episodes at which the next IPT is due, or at which the budget is spent."""
        return min((self.progress.episodes // self.test_every + 1) * self.test_every, self.budget.max_episodes)

    def _learn(self, world: World, burst: Burst) -> None:
        """Store a burst, and make the updates that are due after each of its units."""
        budget = self.budget
        with memory_for("training.batch_size", f"{budget.batch_size} x training.updates {budget.updates}"):
            sample = world.draw(burst)
            losses = [] if sample is None else self.learner.learn(sample, world.lessons)
            if sample is not None:
                world.learned(sample)
        if losses:
            self.progress.updates += len(losses)
            self.progress.loss = float(torch.stack(losses).mean())
            if not math.isfinite(self.progress.loss):
                raise self._diverged("the loss is")

    def _diverged(self, what: str) -> Diverged:
        progress = self.progress
        return Diverged(
            f"{what} {progress.loss} after {progress.updates} updates "
            f"({progress.env_steps} env steps); try a lower optimizer.lr"
        )

    def check_weights(self) -> None:
        """Check that the weights are worth saving.

        Raises:
            Diverged: a weight is NaN or infinite.
        """
        if not self.learner.finite():
            raise self._diverged("a weight is no longer finite, with a loss of")

    def state_dict(self) -> dict[str, Any]:
        """Named parts: all that the next iteration depends on."""
        return {
            "progress": asdict(self.progress),
            "learner": self.learner.state_dict(),
            "worlds": {name: world.state_dict() for name, world in self.worlds.items()},
            "rng": torch.get_rng_state(),
            "cuda_rng": torch.cuda.get_rng_state_all() if torch.cuda.is_available() else [],
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue as the trainer whose `state_dict` this is."""
        state = _with_worlds(state)
        self.progress = Progress(**state["progress"])
        self.learner.load_state_dict(state["learner"])
        for name, world in self.worlds.items():
            world.load_state_dict(state["worlds"][name])
        torch.set_rng_state(state["rng"])
        if state["cuda_rng"] and torch.cuda.is_available():
            torch.cuda.set_rng_state_all(state["cuda_rng"])


def _with_worlds(state: dict[str, Any]) -> dict[str, Any]:
    """The parts of a checkpoint, also of one from before a run could have several worlds."""
    if "worlds" in state:
        return state
    progress = state["progress"]
    counts = {"filled": progress["filled"], "env_steps": progress["env_steps"], "steps": progress["iteration"]}
    return {**state, "learner": state, "worlds": {MAIN: {**state, **counts}}}
