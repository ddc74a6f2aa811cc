"""Temporal-difference losses of the two DQN structures, as TorchRL LossModules.

B denotes the batch, G the cells. Batches are decoded by an agent: they hold each head's observation, mask and action,
the rewards, `terminated`, and the same under "next".

With `chain=literal`, `heads=independent`, `mask_mode=legal` and `failed_pick=punish` each head's loss is that of
`torchrl.objectives.DQNLoss`; the other forms are not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from tensordict import TensorDictBase, TensorDictParams
from tensordict.nn import TensorDictModule
from tensordict.utils import NestedKey
from torch import Tensor

from dore.learn import keys
from dore.learn.q_loss import FailedPick, MaskMode, QLoss, Values

Heads = Literal["independent", "mean"]
Chain = Literal["natural", "literal"]


class SingleLoss(QLoss):
    """One network with two heads, Q1 for the slot to pick and Q2 for the cell to place on (eqs. 3, 8, 9).

    The paper gives both heads one reward and does not say how they learn from it.

    heads: `independent`: each head bootstraps on its own maximum; `mean`: both on the mean of the two (the
        branching dueling Q-network of Tavakoli et al., 2018).
    """

    @dataclass
    class _AcceptedKeys(QLoss._AcceptedKeys):
        pick_action: NestedKey = keys.SLOT
        pick_value: NestedKey = keys.SLOT_VALUE
        pick_mask: NestedKey = keys.SLOT_MASK

    default_keys = _AcceptedKeys
    network: TensorDictModule
    network_params: TensorDictParams
    target_network_params: TensorDictParams

    def __init__(
        self,
        network: TensorDictModule,
        gamma: float,
        double: bool,
        mask_mode: MaskMode,
        heads: Heads,
        loss_function: str,
        reduction: str = "mean",
    ) -> None:
        super().__init__({"network": network}, gamma, double, mask_mode, loss_function, "punish", reduction)
        self.heads = heads

    def _keys_read(self) -> list[NestedKey]:
        names = self.tensor_keys
        after = (*self._observations, names.pick_mask, names.place_mask, names.place_reward, names.terminated)
        return [*self._observations, names.pick_action, names.place_action, *keys.below("next", *after)]

    def _targets(self, batch: TensorDictBase, online: Values) -> tuple[Tensor, Tensor]:
        names, following = self.tensor_keys, batch["next"]
        values = self._bootstrap("network", following)
        pick, place = (self._best(head, *values, following) for head in ("pick", "place"))
        if self.heads == "mean":
            pick = place = (pick + place) / 2
        reward, discount = following[names.place_reward], self._discount(following)
        return reward + discount * pick, reward + discount * place


class SequentialLoss(QLoss):
    """Two networks, Q_p for the pick and Q_l for the place after the lift (eqs. 10-18).

    chain: `natural`: the pick is worth the best place after it, Q_p(s, p) <- max Q_l(s_l, .), and the place
        leads to the next pick, Q_l(s_l, l) <- r + gamma max Q_p(s', .). `literal`: each network bootstraps on
        its own next state, as section 5.2 reads, the pick network with its own reward.
    failed_pick: see `QLoss`; section 5.2 ends at the pick, so `skip`.
    """

    pick: TensorDictModule
    pick_params: TensorDictParams
    target_pick_params: TensorDictParams
    place: TensorDictModule
    place_params: TensorDictParams
    target_place_params: TensorDictParams

    def __init__(
        self,
        pick: TensorDictModule,
        place: TensorDictModule,
        gamma: float,
        double: bool,
        mask_mode: MaskMode,
        chain: Chain,
        failed_pick: FailedPick,
        loss_function: str,
        reduction: str = "mean",
    ) -> None:
        online = {"pick": pick, "place": place}
        super().__init__(online, gamma, double, mask_mode, loss_function, failed_pick, reduction)
        self.chain = chain

    def _keys_read(self) -> list[NestedKey]:
        names = self.tensor_keys
        pick, place = (self._online[head].in_keys for head in ("pick", "place"))
        read = [*pick, *place, names.pick_action, names.place_action]
        read += [names.picked] * (self.failed_pick == "skip") + keys.below("next", names.place_reward, names.terminated)
        if self.chain == "natural":
            return [*read, names.place_mask, *keys.below("next", *pick, names.pick_mask)]
        read += keys.below(keys.LIFTED, *pick, names.pick_mask, names.terminated)
        return read + keys.below("next", *place, names.place_mask, names.pick_reward)

    def _targets(self, batch: TensorDictBase, online: Values) -> tuple[Tensor, Tensor]:
        names, following = self.tensor_keys, batch["next"]
        reward = following[names.place_reward]
        if self.chain == "literal":
            pick_target = following[names.pick_reward] + self._next_best("pick", batch[keys.LIFTED])
            return pick_target, reward + self._next_best("place", following)
        lifted = self._run_target("place", batch)
        pick_target = self._best("place", lifted, online if self.double else lifted, batch)
        if self.failed_pick == "skip":
            pick_target = torch.where(batch[names.picked][:, None], pick_target, reward)
        return pick_target, reward + self._next_best("pick", following)

    def _next_best(self, head: str, following: TensorDictBase) -> Tensor:
        """Float[B, 1]: what a head expects of its next state, discounted; 0 where that ends the episode."""
        return self._discount(following) * self._best(head, *self._bootstrap(head, following), following)
