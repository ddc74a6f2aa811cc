"""The greedy policy of a trained model as a planner."""

from __future__ import annotations

import os
import time

from torch import Tensor

from dore.configure import make
from dore.errors import InputError, path_of, whole
from dore.learn.agents.common import Agent, agent_from_config
from dore.learn.checkpoint import SHIPPED, load_model
from dore.learn.rollout import greedy_rollout
from dore.planners.base import Planner, RawPlan
from dore.planners.policy import raw_plan_of
from dore.world.episode import MAX_MOVES, Episodes
from dore.world.layout import Layout
from dore.world.problem import Batch
from dore.world.reach import Reach


class Learned(Planner):
    """Acts by the largest legal Q-value; boards it has visited are ruled out, so it never loops.

    Args:
        reach: may differ from the one trained on; the layout only where the networks serve every layout.
        model: a run directory or a model file; None: the one in the package, which does.
        max_moves: gives up after this many.

    Raises:
        InputError: no such model, a damaged one, or one of another layout.
    """

    name = "learned"
    backtrack = False
    """See `greedy_rollout`."""

    def __init__(self, reach: Reach, model: str | os.PathLike[str] | None, max_moves: int) -> None:
        self.reach = reach
        self.max_moves = whole(f"planners.{self.name}.max_moves", max_moves, 1, at_most=MAX_MOVES)
        self._file = SHIPPED if model is None else path_of("model", model)
        self._weights, self._config = load_model(self._file)
        self.agent = self.copy_of_agent()

    def copy_of_agent(self) -> Agent:
        """A new agent with a copy of the model's weights."""
        # Mirror images only help to learn; a layout without one can still be planned on.
        config = dict(self._config)
        if self.reach.mirror is None and isinstance(config.get("agent"), dict):
            config["agent"] = {**config["agent"], "symmetry": False}
        agent = agent_from_config(config, self.reach)
        if not agent.serves_every_layout:
            trained_on: Layout = make(self._config.get("layout"), f"{self._file}: layout")
            wanted, given = trained_on.to_dict(), self.reach.layout.to_dict()
            if wanted != given:
                raise InputError(f"model: {self._file} is for layout {wanted}, this one is {given}")
        try:
            agent.networks.load_state_dict(self._weights)
        except RuntimeError as error:
            why = str(error).splitlines()[0]
            raise InputError(f"model: {self._file} does not fit its own config ({why})") from None
        return agent

    def choose(self, episodes: Episodes) -> tuple[Tensor, Tensor]:
        """The Int64[B] (pick, place) cells of the largest legal values."""
        return self.agent.greedy(episodes)

    def raw_plans(self, batch: Batch) -> list[RawPlan]:
        """The greedy episodes, all at once."""
        began = time.perf_counter()
        rollout = greedy_rollout(self.choose, self.reach, batch, self.max_moves, self.backtrack)
        share = (time.perf_counter() - began) / max(1, len(batch.target))
        return [raw_plan_of(rollout, row, share) for row in range(len(batch.target))]


class Backtracking(Learned):
    """The same, but where no legal move is left, and the paper's policy fails, it takes the last one back and goes on.

    Moves that are taken back count towards `max_moves`, but are not in the plan.
    """

    name = "backtracking"
    backtrack = True
