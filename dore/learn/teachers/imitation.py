"""Imitation of optimal moves (DAgger): a cross-entropy over the sets of optimal choices.

B denotes the batch, G the cells.
"""

from __future__ import annotations

from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from dore.errors import number
from dore.learn import keys
from dore.learn.agents.sequential import Sequential
from dore.learn.features import mirrored_by_chance
from dore.learn.q_loss import masked
from dore.learn.teachers.exact import ExactTeacher
from dore.world.rules import lift

WASTED, LABELLED_CHOICE = "wasted", "labelled"
"""Float[B, G]: the moves that a choice wastes, with optimal play after it; Bool[B, G]: choices that have a label."""
ANY_PICK = 0.25
"""The share of picks that are drawn uniformly from all labelled ones; the places after them are then learned."""
LARGEST = 9
"""More than any move wastes."""


class Imitation(ExactTeacher):
    """Teaches both heads to choose optimally: their outputs become the logarithms of a policy's probabilities.

    The loss of a head is -log(the probability of an optimal choice) + `waste` x (the moves that its choice is expected
    to waste). Not in the paper, whose networks learn from rewards alone.

    Args:
        waste: see above.
        others: see `ExactTeacher`.
    """

    bootstraps = False

    def __init__(self, waste: float, **others: Any) -> None:
        super().__init__(**others)
        self.waste = number("teacher.waste", waste, above=-1e-12, at_most=100.0)

    def decode(self, batch: TensorDictBase, agent: Sequential) -> TensorDict:
        """Stored boards, as they are or mirrored, with labels for the pick and for the place after a pick."""
        board, target, wasted = batch[keys.BOARD], batch[keys.TARGET], self._labels(batch)
        if agent.symmetry:
            (board,), (target,), (wasted,) = mirrored_by_chance(self.reach, [board], [target], wasted)
        labelled = wasted >= 0
        after_pick = torch.where(labelled, wasted, LARGEST).amin(-1)
        pick = self._pick(after_pick, labelled.any(-1))
        row = torch.arange(len(pick), device=pick.device)
        lifted = lift(board, pick)
        return TensorDict(
            {
                "pick": {
                    keys.OBSERVATION: agent.pick_observation(board, target),
                    WASTED: after_pick.float(),
                    LABELLED_CHOICE: labelled.any(-1),
                },
                "place": {
                    keys.OBSERVATION: agent.place_observation(lifted, target),
                    WASTED: wasted[row, pick].float(),
                    LABELLED_CHOICE: labelled[row, pick],
                },
            },
            batch_size=batch.batch_size,
        )

    def _pick(self, after_pick: Tensor, labelled: Tensor) -> Tensor:
        """Int64[B]: the picks whose places are learned: mostly optimal ones, as the policy soon makes."""
        optimal = labelled & (after_pick == after_pick.amin(-1, keepdim=True))
        share = [choices / choices.sum(-1, keepdim=True) for choices in (optimal, labelled)]
        return torch.multinomial((1 - ANY_PICK) * share[0] + ANY_PICK * share[1], 1).squeeze(-1)

    def loss(self, decoded: TensorDictBase, agent: Sequential) -> TensorDict:
        """loss_pick and loss_place."""
        values = agent.loss.online_values(decoded)
        of_head = {"pick": values[keys.PICK_VALUE], "place": values[keys.PLACE_VALUE]}
        return TensorDict({f"loss_{head}": self._loss(found, decoded[head]) for head, found in of_head.items()})

    def _loss(self, values: Tensor, labels: TensorDictBase) -> Tensor:
        """The loss of one head's Float[B, G] values."""
        labelled, wasted = labels[LABELLED_CHOICE], labels[WASTED]
        log_chance = masked(values, labelled, "legal").log_softmax(-1)
        # After a pick that is not optimal even the best place wastes a move, which is not the place's fault.
        excess = wasted - torch.where(labelled, wasted, LARGEST).amin(-1, keepdim=True)
        optimal = labelled & (excess == 0)
        log_good = masked(log_chance, optimal, "legal").logsumexp(-1)
        expected = (log_chance.exp() * excess * labelled).sum(-1)
        return (self.waste * expected - log_good).mean()
