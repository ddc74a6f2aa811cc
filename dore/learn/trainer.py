"""Algorithm 2: collect, store, learn, test, until five IPT batches pass or the budget is spent."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

import torch
from tensordict import TensorDictBase
from torch import nn
from torchrl.data import ReplayBuffer
from torchrl.objectives.utils import HardUpdate, TargetNetUpdater

from dore.learn.agents.common import Agent
from dore.learn.averaging import AveragedWeights
from dore.learn.budget import Budget, LinearEpsilon
from dore.learn.env import RearrangeEnv
from dore.learn.evaluator import PerformanceTest, TestResult
from dore.learn.player import Burst, Player, burst_of, burst_state
from dore.learn.replay import buffer_state, draw_in_order, load_buffer, restore
from dore.memory import memory_for

DECODED_AT_ONCE = 8192
"""Transitions, of which each takes some kilobytes once it is decoded."""


class Diverged(RuntimeError):
    """The loss is no longer finite: names the step, the loss and the last good checkpoint."""


class Ending(StrEnum):
    """Why a training run stopped."""

    PASSED = "passed"
    """The last IPT passed."""
    BUDGET = "budget"
    """Episodes or minutes are spent."""
    INTERRUPTED = "interrupted"
    """Asked to stop; the checkpoint goes on from here."""


@dataclass
class Progress:
    """Where a run is. filled: transitions stored before the first episode. success, rearrangements: of the last IPT;
    best: of the best one; loss: of the last updates."""

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
    """A training run's parts and its loop."""

    def __init__(
        self,
        env: RearrangeEnv,
        agent: Agent,
        buffer: ReplayBuffer,
        optimizer: torch.optim.Optimizer,
        targets: TargetNetUpdater,
        epsilon: LinearEpsilon,
        test: PerformanceTest,
        budget: Budget,
    ) -> None:
        self.env, self.agent, self.buffer = env, agent, buffer
        self.optimizer, self.targets = optimizer, targets
        self.epsilon, self.test, self.budget = epsilon, test, budget
        self.averaged = AveragedWeights(agent.networks, budget.averaging)
        self.player = Player(env, agent, budget.update_after)
        self.progress = Progress()
        self._left: Burst | None = None

    def run(self, report: Report, stop: Callable[[], bool]) -> Ending:
        """Train until the IPT passes, the budget is spent, or `stop` says so.

        Raises:
            Diverged: the loss is NaN or infinite.
        """
        progress, before = self.progress, time.perf_counter() - self.progress.seconds
        while not self.spent():
            tests_before = progress.episodes // self.test.every_episodes
            self.iterate()
            progress.seconds = time.perf_counter() - before
            # Before the first update there is nothing to test.
            due = progress.updates > 0 and progress.episodes // self.test.every_episodes > tests_before
            tested = self.run_test() if due else None
            report(progress, tested)
            if tested is not None and tested.passed and progress.episodes >= self.budget.min_episodes:
                return Ending.PASSED
            if stop() and not self.spent():
                return Ending.INTERRUPTED
        return Ending.BUDGET

    def iterate(self) -> None:
        """One step of every environment, and the updates after it; while the replay is filled, only the step."""
        progress = self.progress
        if not progress.iteration:
            self.player.reset()
        progress.iteration += 1
        if progress.filled < self.budget.fill:
            self._fill()
            return
        if progress.filled and not progress.env_steps:
            self.player.reset()  # What filled the replay was played before the first episode.
        burst = self._left or self._play()
        burst, left = burst.split(burst.until(self._next_stop() - progress.episodes))
        self._left = left if len(left.stored) else None
        if len(burst.stored):
            self._learn(burst)
            progress.episodes += int(burst.episodes[-1])

    def run_test(self) -> TestResult:
        """An IPT of the greedy policy, by the mean of the weights where one is kept."""
        with self.averaged.acting():
            tested = self.test.run(self.agent.greedy)
        self.progress.success, self.progress.rearrangements = tested.success, tested.rearrangements
        return tested

    def spent(self) -> bool:
        """Whether the episodes or minutes are used up."""
        minutes = self.budget.max_minutes
        out_of_time = minutes is not None and self.progress.seconds >= 60 * minutes
        return out_of_time or self.progress.episodes >= self.budget.max_episodes

    def _fill(self) -> None:
        """Store uniformly random play, which counts for nothing (Algorithm 2, line 1)."""
        with memory_for("env.num_envs", self.env.batch_size[0]):
            rows = self.player.play(epsilon=1.0).rows[: self.budget.fill - self.progress.filled]
        if len(rows):
            self._store(rows)
        self.progress.filled += len(rows)

    def _play(self) -> Burst:
        """One step of every environment."""
        progress = self.progress
        progress.epsilon = self.epsilon(progress.env_steps)
        with memory_for("env.num_envs", self.env.batch_size[0]):
            burst = self.player.play(progress.epsilon)
        progress.env_steps += self.env.batch_size[0]
        return burst

    def _next_stop(self) -> int:
        """The number of episodes at which the next IPT is due, or at which the budget is spent."""
        every = self.test.every_episodes
        return min((self.progress.episodes // every + 1) * every, self.budget.max_episodes)

    def _store(self, rows: TensorDictBase) -> None:
        with memory_for("buffer.storage.max_size", self.buffer.storage.max_size):
            self.buffer.extend(rows)

    def _learn(self, burst: Burst) -> None:
        """Store a burst, and make the updates that are due after each of its units."""
        budget = self.budget
        n = budget.batch_size * budget.updates
        with memory_for("training.batch_size", f"{budget.batch_size} x training.updates {budget.updates}"):
            # Drawn and decoded all at once: both are costly in small batches.
            if budget.update_after == "round":
                self._store(burst.rows)
                sample = self.buffer.sample(n) if len(self.buffer) >= budget.learning_starts else None
            else:
                late = burst.stored[len(self.buffer) + burst.stored >= budget.learning_starts]
                sample = draw_in_order(self.buffer, burst.rows, late, n) if len(late) else None
                self._store(burst.rows)
            losses = [] if sample is None else self._updates(sample)
        if losses:
            self.progress.updates += len(losses)
            self.progress.loss = float(torch.stack(losses).mean())
            if not math.isfinite(self.progress.loss):
                raise self._diverged("the loss is")

    def _updates(self, sample: TensorDictBase) -> list[torch.Tensor]:
        """One update for each batch of a sample; their losses."""
        size = self.budget.batch_size
        losses: list[torch.Tensor] = []
        for rows in sample.split(max(1, DECODED_AT_ONCE // size) * size):
            decoded, first = self.agent.decode(restore(rows)), 0
            while first < len(decoded):
                batches = decoded[first : first + size * self._updates_to_next_copy()]
                if len(batches) > size:
                    with self._autocast():
                        batches = self.agent.loss.with_targets(batches)
                losses += [self._update(batch) for batch in batches.split(size)]
                first += len(batches)
        return losses

    def _autocast(self) -> torch.autocast:
        """What the networks multiply in while they learn."""
        return torch.autocast(self.env.reach.device.type, torch.bfloat16, enabled=self.budget.precision == "bfloat16")

    def _updates_to_next_copy(self) -> int:
        """How many updates have the same targets, if they are worked out ahead."""
        if self.agent.loss.double or not isinstance(self.targets, HardUpdate):
            return 1
        # TorchRL copies once every this-many-plus-one updates.
        return int(self.targets.value_network_update_interval - self.targets.counter) + 1

    def _diverged(self, what: str) -> Diverged:
        progress = self.progress
        return Diverged(
            f"{what} {progress.loss} after {progress.updates} updates "
            f"({progress.env_steps} env steps); try a lower optimizer.lr"
        )

    def _update(self, batch: TensorDictBase) -> torch.Tensor:
        with self._autocast():
            loss = self.agent.loss(batch)
        total = loss["loss_pick"] + loss["loss_place"]
        self.optimizer.zero_grad(set_to_none=True)
        total.backward()
        if self.budget.max_grad_norm is not None:
            nn.utils.clip_grad_norm_(self.agent.networks.parameters(), self.budget.max_grad_norm)
        self.optimizer.step()
        self.targets.step()
        self.averaged.step()
        return total.detach()

    def check_weights(self) -> None:
        """What is to be kept can be gone on with: an update may spoil the weights after its loss was fine.

        Raises:
            Diverged: a weight is NaN or infinite.
        """
        if not all(bool(weight.isfinite().all()) for weight in self.agent.networks.parameters()):
            raise self._diverged("a weight is no longer finite, with a loss of")

    def state_dict(self) -> dict[str, Any]:
        """Named parts: all that the next iteration depends on."""
        return {
            "progress": asdict(self.progress),
            "loss": self.agent.loss.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "targets": self.targets.state_dict(),
            "averaged": self.averaged.state_dict(),
            "buffer": buffer_state(self.buffer),
            "player": self.player.state_dict(),
            "left": None if self._left is None else burst_state(self._left),
            "ipt_generator": self.test.generator.get_state(),
            "rng": torch.get_rng_state(),
            "cuda_rng": torch.cuda.get_rng_state_all() if torch.cuda.is_available() else [],
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on as the trainer whose `state_dict` this is."""
        self.progress = Progress(**state["progress"])
        self.agent.loss.load_state_dict(state["loss"])
        self.optimizer.load_state_dict(state["optimizer"])
        self.targets.load_state_dict(state["targets"])
        self.averaged.load_state_dict(state["averaged"])
        with memory_for("buffer.storage.max_size", self.buffer.storage.max_size):
            load_buffer(self.buffer, state["buffer"])
        self.player.load_state_dict(state["player"])
        self._left = None if state["left"] is None else burst_of(state["left"])
        self.test.generator.set_state(state["ipt_generator"])
        torch.set_rng_state(state["rng"])
        if state["cuda_rng"] and torch.cuda.is_available():
            torch.cuda.set_rng_state_all(state["cuda_rng"])
