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
from tensordict import TensorDict, TensorDictBase, TensorDictParams
from tensordict.nn import TensorDictModule, dispatch
from tensordict.utils import NestedKey
from torch import Tensor

from dore.learn import keys
from dore.learn.q_loss import PICK_TARGET, MaskMode, QLoss, best_value

Heads = Literal["independent", "mean"]
Chain = Literal["natural", "literal"]
FailedPick = Literal["skip", "punish"]
PICKED = "picked"
"""Bool[B]: the pick did not fail, so something was placed."""
LIFTED = "lifted"
"""The pick head's observation, mask and `terminated` after the lift: its next state in the literal chain."""


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
        super().__init__({"network": network}, gamma, double, mask_mode, loss_function, reduction)
        self.heads = heads

    def _keys_read(self) -> list[NestedKey]:
        names = self.tensor_keys
        after = (*self._observations, names.pick_mask, names.place_mask, names.place_reward, names.terminated)
        return [*self._observations, names.pick_action, names.place_action, *keys.below("next", *after)]

    @dispatch
    def forward(self, tensordict: TensorDictBase) -> TensorDict:
        """loss_pick and loss_place of a decoded batch, or of one with its targets."""
        values = self._run("network", tensordict)
        batch = tensordict if PICK_TARGET in tensordict.keys(True) else self.with_targets(tensordict)
        names = self.tensor_keys
        return self._losses(tensordict, batch, (values[names.pick_value], values[names.place_value]))

    @torch.no_grad()
    def with_targets(self, batch: TensorDictBase) -> TensorDict:
        """See `QLoss.with_targets`."""
        names = self.tensor_keys
        following = batch["next"]
        target, chosen_by = self._bootstrap("network", following)
        best = [
            best_value(target[value], chosen_by[value], following[mask], self.mask_mode)
            for value, mask in ((names.pick_value, names.pick_mask), (names.place_value, names.place_mask))
        ]
        if self.heads == "mean":
            best = [(best[0] + best[1]) / 2] * 2
        discount = self.gamma * ~following[names.terminated]
        pick_target, place_target = (following[names.place_reward] + discount * value for value in best)
        kept = batch.select(*self._observations, names.pick_action, names.place_action)
        return kept.update({"pick": {"target": pick_target}, "place": {"target": place_target}})


class SequentialLoss(QLoss):
    """Two networks, Q_p for the pick and Q_l for the place after the lift (eqs. 10-18).

    chain: `natural`: the pick is worth the best place after it, Q_p(s, p) <- max Q_l(s_l, .), and the place
        leads to the next pick, Q_l(s_l, l) <- r + gamma max Q_p(s', .). `literal`: each network bootstraps on
        its own next state, as section 5.2 reads, the pick network with its own reward.
    failed_pick: what Q_l learns where the pick failed and nothing was lifted: `skip`: nothing (section 5.2 ends at
        the pick); `punish`: r_n.
    """

    @dataclass
    class _AcceptedKeys(QLoss._AcceptedKeys):
        picked: NestedKey = PICKED

    default_keys = _AcceptedKeys
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
        super().__init__({"pick": pick, "place": place}, gamma, double, mask_mode, loss_function, reduction)
        self.chain = chain
        self.failed_pick = failed_pick

    def _keys_read(self) -> list[NestedKey]:
        names = self.tensor_keys
        pick, place = (self._online[head].in_keys for head in ("pick", "place"))
        read = [*pick, *place, names.pick_action, names.place_action, names.picked]
        read += keys.below("next", names.place_reward, names.terminated)
        if self.chain == "natural":
            return [*read, names.place_mask, *keys.below("next", *pick, names.pick_mask)]
        read += keys.below(LIFTED, *pick, names.pick_mask, names.terminated)
        return read + keys.below("next", *place, names.place_mask, names.pick_reward)

    @dispatch
    def forward(self, tensordict: TensorDictBase) -> TensorDict:
        """loss_pick and loss_place of a decoded batch, or of one with its targets."""
        names = self.tensor_keys
        pick_values = self._run("pick", tensordict)[names.pick_value]
        place_values = self._run("place", tensordict)[names.place_value]
        batch = tensordict
        if PICK_TARGET not in batch.keys(True):
            batch = self._with_targets(batch, place_values.detach() if self.double else None)
        counted = batch[names.picked] if self.failed_pick == "skip" else None
        return self._losses(tensordict, batch, (pick_values, place_values), counted)

    def with_targets(self, batch: TensorDictBase) -> TensorDict:
        """See `QLoss.with_targets`.

        Raises:
            ValueError: Q-learning is double, so targets change with the online networks.
        """
        if self.double:
            raise ValueError("with_targets: not for double Q-learning, whose targets change with each update")
        return self._with_targets(batch, None)

    @torch.no_grad()
    def _with_targets(self, batch: TensorDictBase, online_place: Tensor | None) -> TensorDict:
        """online_place: the online values of the places, which choose where Q-learning is double."""
        names = self.tensor_keys
        pick_target, place_target = (
            self._natural(batch, online_place) if self.chain == "natural" else self._literal(batch)
        )
        kept = batch.select(*self._observations, names.pick_action, names.place_action, names.picked)
        return kept.update({"pick": {"target": pick_target}, "place": {"target": place_target}})

    def _natural(self, batch: TensorDictBase, online_place: Tensor | None) -> tuple[Tensor, Tensor]:
        names, following = self.tensor_keys, batch["next"]
        reward = following[names.place_reward]
        lifted = self._run_target("place", batch)[names.place_value]
        chosen_by = lifted if online_place is None else online_place
        pick_target = best_value(lifted, chosen_by, batch[names.place_mask], self.mask_mode)
        if self.failed_pick == "skip":
            pick_target = torch.where(batch[names.picked][:, None], pick_target, reward)
        discount = self.gamma * ~following[names.terminated]
        return pick_target, reward + discount * self._next_best("pick", following)

    def _literal(self, batch: TensorDictBase) -> tuple[Tensor, Tensor]:
        names, lifted, following = self.tensor_keys, batch[LIFTED], batch["next"]
        continues = ~lifted[names.terminated]
        pick_target = following[names.pick_reward] + self.gamma * continues * self._next_best("pick", lifted)
        continues = ~following[names.terminated]
        place_target = following[names.place_reward] + self.gamma * continues * self._next_best("place", following)
        return pick_target, place_target

    def _next_best(self, head: str, batch: TensorDictBase) -> Tensor:
        names = self.tensor_keys
        value, mask = (names.pick_value, names.pick_mask) if head == "pick" else (names.place_value, names.place_mask)
        target, chosen_by = self._bootstrap(head, batch)
        return best_value(target[value], chosen_by[value], batch[mask], self.mask_mode)
