"""Algorithm 1, lines 3-18: where the model fails, a copy of it is trained on that one instance until it solves it."""

from __future__ import annotations

import os
import time

import torch
from torchrl.objectives import SoftUpdate

from dore.errors import number, seed_of, whole
from dore.learn.agents.common import Agent
from dore.learn.budget import Budget, LinearEpsilon
from dore.learn.checkpoint import Q_NETWORK
from dore.learn.env import RearrangeEnv, Rewards
from dore.learn.evaluator import PerformanceTest
from dore.learn.learner import Learner
from dore.learn.rollout import Rollout, greedy_rollout
from dore.learn.trainer import MAIN, StopReason, Trainer
from dore.learn.worlds import World
from dore.planners.base import EXHAUSTED, LOCKED, Planner, RawPlan
from dore.planners.compiled import glance
from dore.planners.instance_memory import InstanceMemory, Returning
from dore.planners.learned import Learned
from dore.planners.policy import raw_plan_of
from dore.world.instances import InstanceSet
from dore.world.kernels import slices
from dore.world.plan import Status
from dore.world.problem import Batch
from dore.world.reach import Reach

NUM_ENVS = 512
"""Episodes of the one instance that are played at once: exploration is the bottleneck, and it is cheap."""
ROUND_S = 4e-7
"""A round of this many seconds for each environment and each pair of cells, at most: measured on 10 x 10 at 45 %."""
TEST_EVERY = 16
"""Episodes between two tests (Algorithm 1: one)."""


class Transfer(Planner):
    """The greedy policy; on failure, transfer learning on a copy. The base model does not change.

    The experience memory is made from the failed instance alone (`InstanceMemory`), by epsilon-greedy moves. The copy
    is tested on it every few episodes, and its first success ends the learning (the paper tests after each episode;
    ours plays many at once).

    Not in the paper, which learns until T_lim: an instance is proved unsolvable where what blocks its target can
    never be reached (`glance`), or where the memory holds all boards that can be reached.

    Args:
        reach: may differ from the one trained on, as for `Learned`.
        model: a run directory or a model file; None: the one in the package that learned from rewards alone.
        max_moves: step limit of an episode.
        max_episodes: T_lim, for one instance.
        max_seconds: of learning, for one instance. With fewer, fewer episodes are played at once.
        epsilon: share of random choices while learning.
        lr: of Adam.
        batch_size: transitions an update.
        seed: of exploration and sampling, set again for each instance.

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
        # Checked under this planner's keys, before `Learned` and `Budget` name their own.
        for name, value in {"max_moves": max_moves, "max_episodes": max_episodes, "batch_size": batch_size}.items():
            whole(f"planners.transfer.{name}", value, 1)
        self.reach = reach
        self.base = Learned(reach, Q_NETWORK if model is None else model, max_moves)
        self.max_moves = max_moves
        self.seed = seed_of("planners.transfer.seed", seed)
        self.lr = number("planners.transfer.lr", lr, above=0.0, at_most=10.0)
        number("planners.transfer.epsilon", epsilon, above=0.0, at_most=1.0)
        self.epsilon = LinearEpsilon(epsilon, epsilon, anneal_steps=1)
        max_seconds = number("planners.transfer.max_seconds", max_seconds, above=0.0, at_most=1e7)
        # The clock is looked at between rounds, which take a twentieth of the seconds at most.
        self.num_envs = max(8, min(NUM_ENVS, int(max_seconds / 20 / ROUND_S / reach.n_cells**2)))
        self.budget = Budget(
            min_episodes=0,
            max_episodes=max_episodes,
            max_minutes=max_seconds / 60,
            batch_size=batch_size,
            update_after="round",
            updates=4,
            fill=0,
            keep="last",
            learning_starts=2 * self.num_envs,
            max_grad_norm=10.0,
            averaging=None,
            precision="float32",
            clock="cpu",
        )

    def raw_plans(self, batch: Batch) -> list[RawPlan]:
        """The base model on all instances at once, then transfer learning, one instance after the other."""
        began = time.perf_counter()
        raw_plans = self.base.raw_plans(batch)
        outcome = glance(self.reach, batch).outcome
        share = (time.perf_counter() - began) / max(1, len(batch.target))
        for row, raw_plan in enumerate(raw_plans):
            if outcome[row] == slices.LOCKED:
                raw_plans[row] = RawPlan([], Status.UNSOLVABLE, share, raw_plan.expansions, reason=LOCKED)
            elif raw_plan.status is Status.SOLVED:
                raw_plans[row] = raw_plan._replace(planning_s=share)
            else:
                alone = InstanceSet(self.reach, batch.board[row, None], batch.target[row, None])
                raw_plans[row] = self._learn(alone, share)
        return raw_plans

    def _learn(self, instance: InstanceSet, spent_s: float) -> RawPlan:
        """The plan of a copy of the model that learns on one instance; its reason says for how long."""
        began = time.perf_counter()
        memory = InstanceMemory(instance)
        if memory.exhausted():
            return _refusal(memory, spent_s + time.perf_counter() - began)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(self.seed)
            agent = self.base.copy_of_agent()
            agent.n_steps = 1  # The memory follows each move.
            trainer = self._trainer(agent, memory)
            stopped = trainer.run(lambda progress, tested: None, stop=memory.exhausted)
        rollout: Rollout = greedy_rollout(agent.greedy, self.reach, instance.batch(), self.max_moves)
        seconds, steps = spent_s + time.perf_counter() - began, trainer.progress.env_steps
        if stopped is StopReason.INTERRUPTED:
            return _refusal(memory, seconds)._replace(expansions=steps)
        raw_plan = raw_plan_of(rollout, 0, seconds)
        learned = f"after {trainer.progress.episodes} episodes"
        reason = f"{raw_plan.reason} {learned}" if raw_plan.reason else learned
        return raw_plan._replace(reason=reason, expansions=steps)

    def _trainer(self, agent: Agent, memory: InstanceMemory) -> Trainer:
        rewards = Rewards(solved=10.0, unfinished=0.0, failed=-1.0)
        env = RearrangeEnv(self.reach, Returning(memory, self.seed), self.num_envs, self.max_moves, rewards)
        evaluator = PerformanceTest(memory.instance, 1, 1, 1.0, TEST_EVERY, self.max_moves, self.seed)
        # Starts the targets from the base weights too.
        targets = SoftUpdate(agent.loss, tau=0.1)
        optimizer = torch.optim.Adam(agent.networks.parameters(), lr=self.lr)
        learner = Learner(agent, optimizer, targets, self.budget)
        world = World(env, agent, memory, evaluator, self.budget)
        return Trainer(learner, {MAIN: world}, self.epsilon, self.budget)


def _refusal(memory: InstanceMemory, seconds: float) -> RawPlan:
    """The memory's proof that there is no plan."""
    return RawPlan([], Status.UNSOLVABLE, seconds, reason=EXHAUSTED.format(len(memory.boards)))
