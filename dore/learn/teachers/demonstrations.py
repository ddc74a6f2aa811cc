"""Q-learning from demonstrations (DQfD, Hester and others, 2018), with sets of optimal choices.

B denotes the batch, G the cells.
"""

from __future__ import annotations

from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from dore.errors import InputError, number
from dore.learn import keys
from dore.learn.agents.common import Agent
from dore.learn.agents.sequential import Sequential
from dore.learn.q_loss import masked
from dore.learn.replay import compact
from dore.learn.teachers.exact import LABELS, ExactTeacher

OPTIMAL = "optimal"
"""Bool[B, G]: the optimal choices; none where no choice has a label."""


class Demonstrations(ExactTeacher):
    """Adds to the Q-learning of each head a margin: `weight` x (max over choices of Q + `margin` where the choice is
    not optimal, less the largest Q of an optimal choice). It learns from all steps, labelled or not.

    Args:
        margin, weight: see above.
        others: see `ExactTeacher`.
    """

    def __init__(self, margin: float, weight: float, **others: Any) -> None:
        super().__init__(**others)
        self.margin = number("teacher.margin", margin, above=0.0, at_most=1e3)
        self.weight = number("teacher.weight", weight, above=0.0, at_most=1e3)

    def kept(self, step: TensorDictBase, agent: Agent) -> TensorDict:
        """TensorDict[N]: all steps, with their labels."""
        return compact(step, (*agent.stored, LABELS), self.reach.n_cells)

    def check(self, agent: Sequential) -> None:
        """Raise InputError where this agent cannot be taught."""
        if agent.symmetry:
            raise InputError(
                "agent.symmetry: got true, want false with teacher=demonstrations: its labels stay as they are"
            )

    def decode(self, batch: TensorDictBase, agent: Sequential) -> TensorDictBase:
        """What Q-learning needs, and which choices are optimal: the place's after the pick that was made."""
        decoded = agent.decode(batch)
        wasted, row = self._labels(batch), torch.arange(len(batch), device=batch.device)
        decoded["pick", OPTIMAL] = (wasted == 0).any(-1)
        of_place = wasted[row, batch[keys.PICK]]
        least = torch.where(of_place >= 0, of_place, torch.iinfo(of_place.dtype).max).amin(-1, keepdim=True)
        decoded["place", OPTIMAL] = (of_place >= 0) & (of_place == least)
        return decoded

    def loss(self, decoded: TensorDictBase, agent: Sequential) -> TensorDict:
        """loss_pick and loss_place: Q-learning's, and the margins."""
        values = agent.loss.online_values(decoded)
        losses: TensorDict = agent.loss.losses_of(decoded, values)
        of_head = {"pick": values[keys.PICK_VALUE], "place": values[keys.PLACE_VALUE]}
        for head, found in of_head.items():
            losses[f"loss_{head}"] = losses[f"loss_{head}"] + self.weight * self._margin(found, decoded[head])
        return losses

    def _margin(self, values: Tensor, labels: TensorDictBase) -> Tensor:
        """The mean over rows of how much the best optimal choice lacks to lead all others by the margin."""
        optimal = labels[OPTIMAL]
        rival = masked(values + self.margin * ~optimal, labels["mask"], "legal").amax(-1)
        best = masked(values, optimal, "legal").amax(-1)
        known = optimal.any(-1)
        return torch.where(known, rival - torch.where(known, best, 0.0), 0.0).mean()
