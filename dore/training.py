"""Algorithm 2: collect, store, learn, test, until five IPT batches pass or the budget is spent."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any

import torch
from tensordict import TensorDictBase
from torch import nn
from torchrl.data import ReplayBuffer
from torchrl.objectives.utils import TargetNetUpdater

from dore import keys
from dore.agents.common import Agent
from dore.env import RearrangeEnv
from dore.errors import number, whole
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


@dataclass(frozen=True)
class LinearEpsilon:
    """Epsilon falls in a straight line over the first `anneal_steps` environment steps.

    Raises:
        InputError: a share outside [0, 1], or fewer than one step.
    """

    start: float
    end: float
    anneal_steps: int

    def __post_init__(self) -> None:
        number("exploration.start", self.start, above=-1e-12, at_most=1.0)
        number("exploration.end", self.end, above=-1e-12, at_most=1.0)
        whole("exploration.anneal_steps", self.anneal_steps, 1)

    def __call__(self, env_steps: int) -> float:
        """Epsilon after so many environment steps."""
        done = min(1.0, env_steps / self.anneal_steps)
        return self.start + done * (self.end - self.start)


@dataclass(frozen=True)
class Budget:
    """When a run ends without passing, and how it learns on the way.

    min_episodes: before so many no test ends the run: plans get shorter after success is high (paper: 0).
    max_episodes: T_lim. max_minutes: of training, None for no limit.
    batch_size: transitions an update. updates_per_step: updates after each step of all environments.
    learning_starts: transitions in the buffer before the first update (Table 5's replay start size).
    max_grad_norm: gradients are scaled down to this norm; None: never (the paper says nothing of it).

    Raises:
        InputError: a number outside its domain.
    """

    min_episodes: int
    max_episodes: int
    max_minutes: float | None
    batch_size: int
    updates_per_step: int
    learning_starts: int
    max_grad_norm: float | None

    def __post_init__(self) -> None:
        whole("training.min_episodes", self.min_episodes, 0)
        for name in ("max_episodes", "batch_size", "updates_per_step", "learning_starts"):
            whole(f"training.{name}", getattr(self, name), 1)
        for name in ("max_minutes", "max_grad_norm"):
            if getattr(self, name) is not None:
                number(f"training.{name}", getattr(self, name), above=0.0)


@dataclass
class Progress:
    """Where a run is. success, rearrangements: of the last IPT; loss: of the last update."""

    iteration: int = 0
    env_steps: int = 0
    episodes: int = 0
    updates: int = 0
    seconds: float = 0.0
    loss: float = math.nan
    epsilon: float = 1.0
    success: float | None = None
    rearrangements: float | None = None
    best_success: float = field(default=-1.0)


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
            due = progress.episodes // self.test.every_episodes > tests_before
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
        """An IPT of the greedy policy as it is now."""
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
        with memory_for("training.batch_size", self.budget.batch_size):
            losses = [self._update() for _ in range(self.budget.updates_per_step)]
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

    def _update(self) -> torch.Tensor:
        sample = self.buffer.sample(self.budget.batch_size)
        loss = self.agent.loss(self.agent.decode(restore(sample)))
        total = loss["loss_pick"] + loss["loss_place"]
        self.optimizer.zero_grad(set_to_none=True)
        total.backward()
        if self.budget.max_grad_norm is not None:
            nn.utils.clip_grad_norm_(self.agent.networks.parameters(), self.budget.max_grad_norm)
        self.optimizer.step()
        self.targets.step()
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
        with memory_for("buffer.storage.max_size", self.buffer.storage.max_size):
            load_buffer(self.buffer, state["buffer"])
        self.env.load_state_dict(state["env"])
        self.test.generator.set_state(state["ipt_generator"])
        torch.set_rng_state(state["rng"])
        if state["cuda_rng"] and torch.cuda.is_available():
            torch.cuda.set_rng_state_all(state["cuda_rng"])
