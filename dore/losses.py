"""Temporal-difference losses of the two DQN structures, as TorchRL LossModules with target networks.

B denotes the batch, G the cells, n the outputs of a head. Batches are decoded by an agent: they hold each
head's observation, mask and action, the rewards, `terminated`, and the same under "next".
"""

from __future__ import annotations

from typing import Literal

import torch
from tensordict import TensorDict, TensorDictBase, TensorDictParams
from tensordict.nn import TensorDictModule
from torch import Tensor
from torchrl.objectives.common import LossModule
from torchrl.objectives.utils import distance_loss

from dore import keys

MaskMode = Literal["legal", "literal"]
Heads = Literal["independent", "mean"]
Chain = Literal["natural", "literal"]


def masked(values: Tensor, mask: Tensor, mode: MaskMode) -> Tensor:
    """Q-values Float[B, n] of which the greedy choice is the argmax, under Bool[B, n].

    `legal`: illegal entries become the lowest float. `literal`: Q x mask (eqs. 14, 18), where an illegal entry
    counts 0 and so beats legal negative ones.
    """
    if mode == "literal":
        return values * mask
    return values.masked_fill(~mask, torch.finfo(values.dtype).min)


def best_value(values: Tensor, chosen_by: Tensor, mask: Tensor, mode: MaskMode) -> Tensor:
    """Float[B, 1]: the value of the greedy choice of `chosen_by`; 0 where nothing is legal.

    `chosen_by` is `values` itself for plain Q-learning, the online network's for double Q-learning.
    """
    choice = masked(chosen_by, mask, mode).argmax(-1, keepdim=True)
    value = values.gather(-1, choice)
    if mode == "literal":
        value = value * mask.gather(-1, choice)
    return torch.where(mask.any(-1, keepdim=True), value, 0.0)


class _QLoss(LossModule):
    """What both losses share: greedy values by target networks."""

    def __init__(self, gamma: float, double: bool, mask_mode: MaskMode, loss_function: str) -> None:
        super().__init__()
        self.gamma = gamma
        self.double = double
        self.mask_mode = mask_mode
        self.loss_function = loss_function

    def _forward_value_estimator_keys(self, **kwargs: object) -> None:
        """Nothing to forward: the bootstrap is worked out here."""

    def _run(self, name: str, batch: TensorDictBase, params: TensorDictParams) -> TensorDictBase:
        """The outputs of a network on a batch, under the given parameters."""
        network: TensorDictModule = getattr(self, name)
        with params.to_module(network, preserve_module_state=False):
            outputs = network(batch.select(*network.in_keys))
        # Under autocast they are of fewer bits; targets and errors are not worked out in these.
        return outputs.update({key: outputs[key].float() for key in network.out_keys})

    def _bootstrap(self, name: str, batch: TensorDictBase) -> tuple[TensorDictBase, TensorDictBase]:
        """Target outputs, and those that choose the action."""
        target = self._run(name, batch, getattr(self, f"target_{name}_params"))
        chosen_by = self._run(name, batch, getattr(self, f"{name}_params").data) if self.double else target
        return target, chosen_by

    def _error(self, values: Tensor, action: Tensor, target: Tensor) -> Tensor:
        """The mean loss of the chosen actions' values."""
        chosen = values.gather(-1, action[:, None])
        return distance_loss(chosen, target, self.loss_function).mean()


class SingleLoss(_QLoss):
    """One network with two heads, Q1 for the slot to pick and Q2 for the cell to place on (eqs. 3, 8, 9).

    The paper gives both heads one reward and does not say how they learn from it.

    heads: `independent`: each head bootstraps on its own maximum; `mean`: both on the mean of the two (the
        branching dueling Q-network of Tavakoli et al., 2018).
    """

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
    ) -> None:
        super().__init__(gamma, double, mask_mode, loss_function)
        self.convert_to_functional(network, "network", create_target_params=True)
        self.heads = heads
        self.in_keys = list(network.in_keys)

    def forward(self, tensordict: TensorDictBase) -> TensorDict:
        """loss_pick and loss_place of a decoded batch."""
        values = self._run("network", tensordict, self.network_params)
        following = tensordict["next"]
        with torch.no_grad():
            target, chosen_by = self._bootstrap("network", following)
            best = [
                best_value(target[value], chosen_by[value], following[mask], self.mask_mode)
                for value, mask in ((keys.SLOT_VALUE, keys.SLOT_MASK), (keys.PLACE_VALUE, keys.PLACE_MASK))
            ]
            if self.heads == "mean":
                best = [(best[0] + best[1]) / 2] * 2
            discount = self.gamma * ~following[keys.TERMINATED]
            pick_target, place_target = (following[keys.PLACE_REWARD] + discount * value for value in best)
        return TensorDict(
            {
                "loss_pick": self._error(values[keys.SLOT_VALUE], tensordict[keys.SLOT], pick_target),
                "loss_place": self._error(values[keys.PLACE_VALUE], tensordict[keys.PLACE], place_target),
            }
        )


class SequentialLoss(_QLoss):
    """Two networks, Q_p for the pick and Q_l for the place after the lift (eqs. 10-18).

    chain: `natural`: the pick is worth the best place after it, Q_p(s, p) <- max Q_l(s_l, .), and the place
        leads to the next pick, Q_l(s_l, l) <- r + gamma max Q_p(s', .). `literal`: each network bootstraps on
        its own next state, as section 5.2 reads, the pick network with its own reward.
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
        loss_function: str,
    ) -> None:
        super().__init__(gamma, double, mask_mode, loss_function)
        self.convert_to_functional(pick, "pick", create_target_params=True)
        self.convert_to_functional(place, "place", create_target_params=True)
        self.chain = chain
        self.in_keys = [*pick.in_keys, *place.in_keys]

    def forward(self, tensordict: TensorDictBase) -> TensorDict:
        """loss_pick and loss_place of a decoded batch."""
        pick_values = self._run("pick", tensordict, self.pick_params)[keys.PICK_VALUE]
        place_values = self._run("place", tensordict, self.place_params)[keys.PLACE_VALUE]
        with torch.no_grad():
            targets = self._natural if self.chain == "natural" else self._literal
            pick_target, place_target = targets(tensordict, place_values)
        return TensorDict(
            {
                "loss_pick": self._error(pick_values, tensordict[keys.PICK], pick_target),
                "loss_place": self._error(place_values, tensordict[keys.PLACE], place_target),
            }
        )

    def _natural(self, batch: TensorDictBase, place_values: Tensor) -> tuple[Tensor, Tensor]:
        following = batch["next"]
        lifted = self._run("place", batch, self.target_place_params)[keys.PLACE_VALUE]
        chosen_by = place_values.detach() if self.double else lifted
        pick_target = best_value(lifted, chosen_by, batch[keys.PLACE_MASK], self.mask_mode)
        discount = self.gamma * ~following[keys.TERMINATED]
        return pick_target, following[keys.PLACE_REWARD] + discount * self._next_best("pick", following)

    def _literal(self, batch: TensorDictBase, place_values: Tensor) -> tuple[Tensor, Tensor]:
        lifted, following = batch["lifted"], batch["next"]
        goes_on = ~lifted[keys.TERMINATED]
        pick_target = following[keys.PICK_REWARD] + self.gamma * goes_on * self._next_best("pick", lifted)
        goes_on = ~following[keys.TERMINATED]
        place_target = following[keys.PLACE_REWARD] + self.gamma * goes_on * self._next_best("place", following)
        return pick_target, place_target

    def _next_best(self, head: str, batch: TensorDictBase) -> Tensor:
        target, chosen_by = self._bootstrap(head, batch)
        value = (head, "action_value")
        return best_value(target[value], chosen_by[value], batch[head, "mask"], self.mask_mode)
