"""What a learner learns from: an environment with its player, a replay and an evaluator."""

from __future__ import annotations

from typing import Any

from tensordict import TensorDictBase
from torchrl.data import ReplayBuffer

from dore.errors import InputError
from dore.learn import keys
from dore.learn.agents.common import Agent
from dore.learn.budget import Budget
from dore.learn.env import RearrangeEnv
from dore.learn.evaluator import PerformanceTest, TestResult
from dore.learn.memory import memory_for
from dore.learn.player import Burst, Player, burst_of, burst_state
from dore.learn.replay import buffer_state, check_uniform, draw, draw_in_order, has_priorities, load_buffer, restore
from dore.learn.teachers.exact import ExactTeacher, Lessons


class World:
    """A layout under a reach, with instances to learn from and others to be tested on.

    Args:
        env: plays the training instances.
        agent: the learner's, on this world's reach.
        buffer: the replay; uniform, prioritised, or with a `sample` of its own; the last two for `update_after=round`.
        evaluator: tests on the validation instances.
        budget: how much is stored and drawn, and when.
        teacher: labels what is played, on this world's reach; None: the learner learns from its rewards alone.

    Raises:
        InputError: a sampler of another kind; one, or returns of several steps, that do not go with `update_after` or
            the teacher; or a teacher with updates after anything else than a round.
    """

    def __init__(
        self,
        env: RearrangeEnv,
        agent: Agent,
        buffer: ReplayBuffer,
        evaluator: PerformanceTest,
        budget: Budget,
        teacher: ExactTeacher | None = None,
    ) -> None:
        if not has_priorities(buffer):
            check_uniform(buffer, " or Prioritized")
        elif teacher or budget.update_after != "round":
            check_uniform(buffer, f" with {'a teacher' if teacher else 'training.update_after=' + budget.update_after}")
        if teacher and budget.update_after != "round":
            raise InputError(f"training.update_after: got {budget.update_after}, want round with a teacher")
        if agent.n_steps > 1 and (teacher or budget.update_after == "step"):
            beside = "a teacher" if teacher else "training.update_after=step"
            raise InputError(f"agent.n_steps: got {agent.n_steps}, want 1 with {beside}")
        if budget.update_after != "round" and type(buffer).sample is not ReplayBuffer.sample:
            raise InputError(
                f"training.update_after: {budget.update_after} draws by itself, want round for this buffer"
            )
        self.env, self.agent, self.buffer, self.evaluator, self.budget = env, agent, buffer, evaluator, budget
        self.player = Player(env, agent, budget.update_after, teacher)
        self.lessons = Lessons(teacher, agent) if teacher else agent
        self.filled = self.env_steps = self._steps = 0
        self._left: Burst | None = None

    @property
    def filling(self) -> bool:
        """Whether the replay is still to be filled before anything counts."""
        return self.filled < self.budget.fill

    @property
    def has_left(self) -> bool:
        """Whether units were played that wait for their updates."""
        return self._left is not None

    def fill(self) -> int:
        """Store a step of uniformly random play (Algorithm 2, line 1); how many transitions that were."""
        rows = self._step(epsilon=1.0).rows[: self.budget.fill - self.filled]
        if len(rows):
            self._store(rows)
        self.filled += len(rows)
        return len(rows)

    def play(self, epsilon: float, n_episodes: int) -> Burst:
        """A step of every environment, or what an earlier one has left, until `n_episodes` have ended at most."""
        burst = self._left
        if burst is None:
            if self.filled and not self.env_steps:
                self.player.reset()  # What filled the replay was played before the first episode.
            burst = self._step(epsilon)
            self.env_steps += self.env.batch_size[0]
        burst, left = burst.split(burst.until(n_episodes))
        self._left = left if len(left.stored) else None
        return burst

    def draw(self, burst: Burst) -> TensorDictBase | None:
        """Store a burst; the transitions of all updates that are due, None while too few are stored."""
        budget, buffer = self.budget, self.buffer
        n = budget.batch_size * budget.updates
        # Drawn all at once, which is costly in small batches.
        if budget.update_after == "round":
            self._store(burst.rows)
            sample = draw(buffer, n) if len(buffer) >= budget.learning_starts else None
        else:
            late = burst.stored[len(buffer) + burst.stored >= budget.learning_starts]
            sample = draw_in_order(buffer, burst.rows, late, n) if len(late) else None
            self._store(burst.rows)
        return None if sample is None else restore(sample)

    def learned(self, sample: TensorDictBase) -> None:
        """Give what was drawn the priorities that follow from its errors, where the replay has any."""
        if has_priorities(self.buffer):
            self.buffer.update_priority(sample[keys.INDEX], sample[keys.ERROR].squeeze(-1))

    def test(self) -> TestResult:
        """An IPT of the greedy policy."""
        return self.evaluator.run(self.agent.greedy)

    def _step(self, epsilon: float) -> Burst:
        if not self._steps:
            self.player.reset()
        self._steps += 1
        with memory_for("env.num_envs", self.env.batch_size[0]):
            return self.player.play(epsilon)

    def _store(self, rows: TensorDictBase) -> None:
        if not len(rows):
            return  # Nothing of it had a label.
        with memory_for("buffer.storage.max_size", self.buffer.storage.max_size):
            self.buffer.extend(rows)

    def state_dict(self) -> dict[str, Any]:
        """All that the next step depends on, but for the weights and the random state."""
        return {
            "filled": self.filled,
            "env_steps": self.env_steps,
            "steps": self._steps,
            "buffer": buffer_state(self.buffer),
            "player": self.player.state_dict() if self._steps else None,  # It has not begun.
            "left": None if self._left is None else burst_state(self._left),
            "ipt_generator": self.evaluator.generator.get_state(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue as the world whose `state_dict` this is."""
        self.filled, self.env_steps, self._steps = state["filled"], state["env_steps"], state["steps"]
        with memory_for("buffer.storage.max_size", self.buffer.storage.max_size):
            load_buffer(self.buffer, state["buffer"])
        if state["player"] is not None:
            self.player.load_state_dict(state["player"])
        self._left = None if state["left"] is None else burst_of(state["left"])
        self.evaluator.generator.set_state(state["ipt_generator"])
