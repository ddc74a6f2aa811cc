"""What learns: an agent with its optimiser, target networks and mean weights. It knows no environment."""

from __future__ import annotations

from typing import Any

import torch
from tensordict import TensorDictBase
from torch import Tensor, nn
from torchrl.objectives.utils import HardUpdate, TargetNetUpdater

from dore.learn import keys
from dore.learn.agents.common import Agent
from dore.learn.averaging import AveragedWeights
from dore.learn.budget import Budget
from dore.learn.teachers.exact import Lessons

DECODED_AT_ONCE = 8192
"""Transitions, of which each takes some kilobytes once it is decoded."""


class Learner:
    """Makes the updates of a training run, from the transitions of one world or of several.

    Args:
        agent: whose networks learn.
        optimizer: of the agent's networks.
        targets: moves the target networks after each update.
        budget: batch size, gradient norm, averaging, precision and how far the learning rate falls.
    """

    def __init__(
        self, agent: Agent, optimizer: torch.optim.Optimizer, targets: TargetNetUpdater, budget: Budget
    ) -> None:
        self.agent, self.optimizer, self.targets, self.budget = agent, optimizer, targets, budget
        self.averaged = AveragedWeights(agent.networks, budget.averaging)
        self._device = next(agent.networks.parameters()).device
        self._first_rates = [group["lr"] for group in optimizer.param_groups]

    def set_rate(self, spent: float) -> None:
        """Set the learning rate after this share of the budget, in [0, 1]: it falls linearly to `lr_end` of itself."""
        if self.budget.lr_end == 1.0:
            return
        for group, first in zip(self.optimizer.param_groups, self._first_rates, strict=True):
            group["lr"] = first * (1.0 - (1.0 - self.budget.lr_end) * spent)

    def learn(self, sample: TensorDictBase, lessons: Agent | Lessons) -> list[Tensor]:
        """One update for each batch of a sample; their losses. A weighted sample gets its `keys.ERROR`.

        lessons: the learner's agent on the reach of the world that the sample is from, or its teacher there.
        """
        size = self.budget.batch_size
        losses: list[Tensor] = []
        errors: list[Tensor] = []
        weighted = keys.WEIGHT in sample
        # Decoded many at once, which is costly in small batches, but in bounded parts.
        for rows in sample.split(max(1, DECODED_AT_ONCE // size) * size):
            decoded, first = lessons.decode(rows), 0
            if weighted:
                decoded[keys.WEIGHT] = rows[keys.WEIGHT]
            while first < len(decoded):
                batches = decoded[first : first + size * self._updates_to_next_copy()]
                if len(batches) > size and isinstance(lessons, Agent) and not weighted:
                    with self._autocast():
                        batches = lessons.loss.with_targets(batches)
                for batch in batches.split(size):
                    losses.append(self.update(batch, lessons))
                    if weighted:
                        errors.append(batch[keys.ERROR])
                first += len(batches)
        if weighted:
            sample[keys.ERROR] = torch.cat(errors)
        return losses

    def _autocast(self) -> torch.autocast:
        """The precision of the networks' multiplications while they learn."""
        return torch.autocast(self._device.type, torch.bfloat16, enabled=self.budget.precision == "bfloat16")

    def _updates_to_next_copy(self) -> int:
        """How many updates share their targets, if these are computed ahead."""
        if self.agent.loss.double or not isinstance(self.targets, HardUpdate):
            return 1
        # TorchRL copies once every this-many-plus-one updates.
        return int(self.targets.value_network_update_interval - self.targets.counter) + 1

    def update(self, batch: TensorDictBase, lessons: Agent | Lessons) -> Tensor:
        """One update from a decoded batch; its loss."""
        with self._autocast():
            loss = lessons.loss(batch)
        total: Tensor = loss["loss_pick"] + loss["loss_place"]
        self.optimizer.zero_grad(set_to_none=True)
        total.backward()
        if self.budget.max_grad_norm is not None:
            nn.utils.clip_grad_norm_(self.agent.networks.parameters(), self.budget.max_grad_norm)
        self.optimizer.step()
        if lessons.bootstraps:
            self.targets.step()
        self.averaged.step()
        return total.detach()

    def finite(self) -> bool:
        """Whether all weights are: an update may spoil them after its loss was fine."""
        return all(bool(weight.isfinite().all()) for weight in self.agent.networks.parameters())

    def state_dict(self) -> dict[str, Any]:
        """All that the next update depends on, but for the random state."""
        return {
            "loss": self.agent.loss.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "targets": self.targets.state_dict(),
            "averaged": self.averaged.state_dict(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue as the learner whose `state_dict` this is."""
        self.agent.loss.load_state_dict(state["loss"])
        self.optimizer.load_state_dict(state["optimizer"])
        self.targets.load_state_dict(state["targets"])
        self.averaged.load_state_dict(state["averaged"])
