"""Plays the environments, and puts what they did in the order in which it is stored and learned from.

M denotes transitions, K units, N environments, T the step limit of an episode.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from tensordict import TensorDictBase
from torch import Tensor

from dore.learn import keys
from dore.learn.agents.common import Agent
from dore.learn.budget import Unit
from dore.learn.env import RearrangeEnv
from dore.learn.n_step import n_step_rows
from dore.learn.replay import compact, rows_of, tensors_of
from dore.learn.teachers.exact import ExactTeacher


class Burst(NamedTuple):
    """Transitions in the order in which they are stored, cut into units; after each unit it is learned.

    rows: TensorDict[M], as `dore.learn.replay.compact` makes them.
    stored: Int64[K], how many rows are stored when a unit ends.
    episodes: Int64[K], how many of the burst's episodes have ended by then.
    """

    rows: TensorDictBase
    stored: Tensor
    episodes: Tensor

    def split(self, n_units: int) -> tuple[Burst, Burst]:
        """The first units, and the rest."""
        if n_units == 0:
            return Burst(self.rows[:0], self.stored[:0], self.episodes[:0]), self
        row, episode = self.stored[n_units - 1], self.episodes[n_units - 1]
        first = Burst(self.rows[:row], self.stored[:n_units], self.episodes[:n_units])
        rest = Burst(self.rows[row:], self.stored[n_units:] - row, self.episodes[n_units:] - episode)
        return first, rest

    def until(self, n_episodes: int) -> int:
        """How many units it takes until `n_episodes` have ended, all of them where the burst has fewer."""
        return min(int((self.episodes < n_episodes).sum()) + 1, len(self.episodes))


def burst_state(burst: Burst) -> dict[str, Any]:
    """A burst as tensors by name."""
    return {"rows": tensors_of(burst.rows), "stored": burst.stored, "episodes": burst.episodes}


def burst_of(state: dict[str, Any]) -> Burst:
    """The burst whose `burst_state` this is, on the CPU."""
    return Burst(rows_of(state["rows"]), state["stored"], state["episodes"])


class Player:
    """Steps all environments at once and returns what is complete.

    With `unit="episode"` the steps of an episode wait until it ends, and then come one after the other: the stores and
    updates have the order of a single environment that plays one episode after the other. What many environments
    change is that an episode is played by weights that are some updates old: no more than the updates made while it
    lasts. With `agent.n_steps` above 1 steps wait too.
    """

    def __init__(self, env: RearrangeEnv, agent: Agent, unit: Unit, teacher: ExactTeacher | None = None) -> None:
        self.env, self.agent, self.teacher = env, agent, teacher
        self.unit = unit
        self._observed: TensorDictBase | None = None
        self._waiting: TensorDictBase | None = None
        self._length = torch.zeros(env.batch_size[0], dtype=torch.int64, device=env.device)

    def reset(self) -> None:
        """Begin a new episode in every environment; the steps of those under way are dropped."""
        self._observed = self.env.reset()
        self._length.zero_()

    @torch.no_grad()
    def play(self, epsilon: float) -> Burst:
        """One step of every environment."""
        self.agent.set_epsilon(epsilon)
        observed = self.env.observation() if self._observed is None else self._observed
        acted = self.teacher.act(observed, self.agent.policy) if self.teacher else self.agent.policy(observed)
        step, self._observed = self.env.step_and_maybe_reset(acted)
        done = step["next", keys.DONE].squeeze(-1)
        n = self.env.batch_size[0]
        if self.teacher:
            rows = self.teacher.kept(step, self.agent)
            return Burst(rows, torch.tensor([len(rows)]), done.sum().cpu()[None])
        rows = compact(step, self.agent.stored, self.env.reach.n_cells)
        if self.unit == "episode":
            return self._whole_episodes(rows, done)
        if self.agent.n_steps > 1:
            whole = self._whole_episodes(rows, done)
            return Burst(whole.rows, torch.tensor([len(whole.rows)]), done.sum().cpu()[None])
        if self.unit == "step":
            return Burst(rows, torch.arange(1, n + 1), done.cumsum(0).cpu())
        return Burst(rows, torch.tensor([n]), done.sum().cpu()[None])

    def _whole_episodes(self, rows: TensorDictBase, done: Tensor) -> Burst:
        """The episodes that end with these TensorDict[N] rows, each with all of its steps."""
        if self._waiting is None:
            self._waiting = rows[:, None].expand(len(rows), self.env.max_moves).clone()
        self._waiting[torch.arange(len(rows), device=done.device), self._length] = rows
        self._length += 1
        ended = done.nonzero().squeeze(-1)
        lengths = self._length[ended]
        played = torch.arange(self.env.max_moves, device=done.device) < lengths[:, None]
        whole = self._waiting[ended]
        if self.agent.n_steps > 1:
            whole = n_step_rows(whole, lengths, self.agent.n_steps, self.agent.loss.gamma)
        self._length[ended] = 0
        return Burst(whole[played], lengths.cumsum(0).cpu(), torch.arange(1, len(ended) + 1))

    def state_dict(self) -> dict[str, Any]:
        """The environments, and the steps of episodes that have not ended."""
        waiting = {} if self._waiting is None else tensors_of(self._waiting)
        return {"env": self.env.state_dict(), "waiting": waiting, "length": self._length.clone()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue as the player whose `state_dict` this is."""
        self.env.load_state_dict(state["env"])
        self._observed = None
        self._length = state["length"].to(self.env.device)
        waiting = state["waiting"]
        self._waiting = rows_of(waiting, batch_dims=2).to(self.env.device) if waiting else None
