"""Algorithm 1, lines 3-18: where the model fails, a copy of it is trained on that one instance until it solves it."""

from __future__ import annotations

import os
import time
from functools import partial

import torch
from torchrl.data import LazyTensorStorage, ReplayBuffer
from torchrl.objectives import SoftUpdate

from dore.agents.common import Agent
from dore.env import RearrangeEnv, Rewards
from dore.errors import number, seed_of
from dore.instances import FixedInstances, InstanceSet
from dore.performance import PerformanceTest
from dore.plan import Plan, Status
from dore.planners.base import Draft, checked_plans
from dore.planners.learned import Learned, draft_of
from dore.reach import Reach
from dore.rollout import Rollout, greedy_rollout
from dore.rules import has_move
from dore.sampling import Batch
from dore.training import Budget, LinearEpsilon, Trainer

NUM_ENVS = 32
"""Episodes of the one instance that are played at once."""


class Transfer:
    """The greedy policy; on failure, transfer learning on a copy. The base model stays as it was.

    The experience memory is made from episodes of the failed instance alone, played by epsilon-greedy moves. Every
    few episodes the copy is tested on it, and its first success ends the learning (the paper tests after each
    episode; ours plays many at once).

    Args:
        reach: as the model's.
        model: a run directory or a model file.
        max_moves: step limit of an episode.
        max_episodes: T_lim, for one instance.
        max_seconds: of learning, for one instance.
        epsilon: share of random choices while learning.
        lr: of Adam.
        batch_size: transitions an update.
        seed: of exploration and sampling, for each instance anew.

    Raises:
        InputError: what `Learned` raises, or a number outside its domain.
    """

    name = "transfer"

    def __init__(
        self,
        reach: Reach,
        model: str | os.PathLike[str] | None,
        max_moves: int,
        max_episodes: int,
        max_seconds: float,
        epsilon: float,
        lr: float,
        batch_size: int,
        seed: int,
    ) -> None:
        self.reach = reach
        self.base = Learned(reach, model, max_moves)
        self.max_moves = max_moves
        self.seed = seed_of("planner.transfer.seed", seed)
        self.lr = number("planner.transfer.lr", lr, above=0.0)
        number("planner.transfer.epsilon", epsilon, above=0.0, at_most=1.0)
        self.epsilon = LinearEpsilon(epsilon, epsilon, anneal_steps=1)
        self.budget = Budget(
            min_episodes=0,
            max_episodes=max_episodes,
            max_minutes=number("planner.transfer.max_seconds", max_seconds, above=0.0) / 60,
            batch_size=batch_size,
            updates_per_step=2,
            learning_starts=2 * NUM_ENVS,
            max_grad_norm=10.0,
        )

    def plan(self, batch: Batch) -> list[Plan]:
        """The base model on all instances at once, then one learning after the other; see `Planner`."""
        began = time.perf_counter()
        rollout = greedy_rollout(self.base.agent.policy, self.reach, batch, self.max_moves)
        share = (time.perf_counter() - began) / max(1, len(batch.target))
        drafts = [draft_of(rollout, row, share) for row in range(len(batch.target))]
        for row, draft in enumerate(drafts):
            alone = Batch(batch.board[row, None], batch.target[row, None])
            if draft.status is not Status.SOLVED and bool(has_move(self.reach, *alone)):
                drafts[row] = self._learn(alone, share)
        return checked_plans(self.reach, batch, drafts, self.name)

    def _learn(self, alone: Batch, spent_s: float) -> Draft:
        """What a copy of the model makes of one instance; the draft's reason says how long it learned."""
        began = time.perf_counter()
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(self.seed)
            agent = self.base.copy_of_agent()
            trainer = self._trainer(agent, InstanceSet(self.reach, *alone))
            trainer.run(lambda progress, tested: None, stop=lambda: False)
        rollout: Rollout = greedy_rollout(agent.policy, self.reach, alone, self.max_moves)
        draft = draft_of(rollout, 0, spent_s + time.perf_counter() - began)
        learned = f"after {trainer.progress.episodes} episodes"
        reason = f"{draft.reason} {learned}" if draft.reason else learned
        return draft._replace(reason=reason, expansions=trainer.progress.env_steps)

    def _trainer(self, agent: Agent, instance: InstanceSet) -> Trainer:
        source = FixedInstances(instance, self.seed)
        rewards = Rewards(solved=10.0, unfinished=0.0, failed=-1.0)
        return Trainer(
            env=RearrangeEnv(self.reach, source, NUM_ENVS, self.max_moves, rewards),
            agent=agent,
            buffer=ReplayBuffer(storage=partial(LazyTensorStorage, 20_000, device=self.reach.device)),
            # Starts the targets from the base weights too.
            targets=SoftUpdate(agent.loss, tau=0.05),
            optimizer=torch.optim.Adam(agent.networks.parameters(), lr=self.lr),
            epsilon=self.epsilon,
            test=PerformanceTest(instance, 1, 1, 1.0, NUM_ENVS, self.max_moves, self.seed),
            budget=self.budget,
        )
