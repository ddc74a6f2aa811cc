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
from torchrl.objectives.utils import TargetNetUpdater

from dore import keys
from dore.agents.common import Agent
from dore.averaging import AveragedWeights
from dore.budget import Budget, LinearEpsilon
from dore.env import RearrangeEnv
from dore.memory import memory_for
from dore.performance import PerformanceTest, TestResult
from dore.replay import buffer_state, compact, load_buffer, restore


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
    """Where a run is. success, rearrangements: of the last IPT; best: of the model that is kept; loss: of the last
    update."""

    iteration: int = 0
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
        self.progress = Progress()

    def run(self, report: Report, stop: Callable[[], bool]) -> Ending:
        """Train until the IPT passes, the budget is spent, or `stop` says so.

        Raises:
            Diverged: the loss is NaN or infinite.
        """
        progress, before = self.progress, time.perf_counter() - self.progress.seconds
        shown = self.env.observation() if progress.iteration else self.env.reset()
        while not self.spent():
            tests_before = progress.episodes // self.test.every_episodes
            shown = self.iterate(shown)
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

    def iterate(self, shown: TensorDictBase) -> TensorDictBase:
        """One step of every environment from what it shows, and the updates after it; what they show next."""
        shown, finished = self._collect(shown)
        self._learn()
        self.progress.episodes += finished
        self.progress.iteration += 1
        return shown

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

    @torch.no_grad()
    def _collect(self, shown: TensorDictBase) -> tuple[TensorDictBase, int]:
        """One step of every environment into the buffer; what they show next, and how many episodes ended."""
        self.progress.epsilon = self.epsilon(self.progress.env_steps)
        self.agent.set_epsilon(self.progress.epsilon)
        with memory_for("env.num_envs", self.env.batch_size[0]):
            step, following = self.env.step_and_maybe_reset(self.agent.policy(shown))
        with memory_for("buffer.storage.max_size", self.buffer.storage.max_size):
            self.buffer.extend(compact(step, self.agent.stored, self.env.reach.n_cells))
        self.progress.env_steps += self.env.batch_size[0]
        return following, int(step["next", keys.DONE].sum())

    def _learn(self) -> None:
        """The updates of one iteration, once the buffer holds enough."""
        if len(self.buffer) < self.budget.learning_starts:
            return
        budget = self.budget
        with memory_for(
            "training.batch_size", f"{budget.batch_size} x training.updates_per_step {budget.updates_per_step}"
        ):
            # All at once, for the buffer stays as it is between them; decoding is dear in small batches.
            sample = restore(self.buffer.sample(budget.batch_size * budget.updates_per_step))
            losses = [self._update(batch) for batch in self.agent.decode(sample).split(budget.batch_size)]
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

    def _update(self, batch: TensorDictBase) -> torch.Tensor:
        device = self.env.reach.device
        with torch.autocast(device.type, torch.bfloat16, enabled=self.budget.precision == "bfloat16"):
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
            "env": self.env.state_dict(),
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
        self.env.load_state_dict(state["env"])
        self.test.generator.set_state(state["ipt_generator"])
        torch.set_rng_state(state["rng"])
        if state["cuda_rng"] and torch.cuda.is_available():
            torch.cuda.set_rng_state_all(state["cuda_rng"])
