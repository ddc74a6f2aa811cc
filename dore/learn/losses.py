"""Temporal-difference losses of the two DQN structures, as TorchRL LossModules with target networks.

B denotes the batch, G the cells, n the outputs of a head. Batches are decoded by an agent: they hold each
head's observation, mask and action, the rewards, `terminated`, and the same under "next".

The online values come from the networks themselves, and only the targets by way of TorchRL's functional parameters,
which take as long as a small network.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import torch
from tensordict import TensorDict, TensorDictBase, TensorDictParams
from tensordict.nn import TensorDictModule
from torch import Tensor
from torchrl.objectives.common import LossModule
from torchrl.objectives.utils import distance_loss

from dore.learn import keys

MaskMode = Literal["legal", "literal"]
Heads = Literal["independent", "mean"]
Chain = Literal["natural", "literal"]
FailedPick = Literal["skip", "punish"]
Values = dict[str | keys.Key, Tensor]
PICK_TARGET, PLACE_TARGET = ("pick", "target"), ("place", "target")
"""Float[B, 1]: what a chosen action's value is drawn to."""
PICKED = "picked"
"""Bool[B]: the pick did not fail, so something was placed."""


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
    """What both losses share: values by the online networks, greedy values by target networks."""

    def __init__(
        self,
        online: Mapping[str, TensorDictModule],
        gamma: float,
        double: bool,
        mask_mode: MaskMode,
        loss_function: str,
    ) -> None:
        super().__init__()
        self.gamma = gamma
        self.double = double
        self.mask_mode = mask_mode
        self.loss_function = loss_function
        for name, network in online.items():
            self.convert_to_functional(network, name, create_target_params=True)
        # No submodules of this one: their parameters are those that `convert_to_functional` has registered.
        self.__dict__["_online"] = dict(online)
        self.in_keys = [key for network in online.values() for key in network.in_keys]

    def _forward_value_estimator_keys(self, **kwargs: object) -> None:
        """Nothing to forward: the bootstrap is worked out here."""

    def with_targets(self, batch: TensorDictBase) -> TensorDict:
        """What `forward` needs of a decoded batch, targets included.

        For many updates between which the target networks stay as they are: one large pass instead of many small ones.
        Not for double Q-learning, where targets also depend on the online networks.
        """
        raise NotImplementedError

    def _run(self, name: str, batch: TensorDictBase) -> Values:
        """What the online network says of a batch."""
        return _values(self._online[name], batch)

    def _run_target(self, name: str, batch: TensorDictBase) -> Values:
        """What the target network says of a batch."""
        network: TensorDictModule = getattr(self, name)
        with getattr(self, f"target_{name}_params").to_module(network, preserve_module_state=False):
            return _values(network, batch)

    def _bootstrap(self, name: str, batch: TensorDictBase) -> tuple[Values, Values]:
        """Target values, and those that choose the action."""
        target = self._run_target(name, batch)
        return target, self._run(name, batch) if self.double else target

    def _error(self, values: Tensor, action: Tensor, target: Tensor, counted: Tensor | None = None) -> Tensor:
        """The mean loss of the chosen actions' values, over the counted rows Bool[B]; 0 where there are none."""
        errors = distance_loss(values.gather(-1, action[:, None]), target, self.loss_function)
        if counted is None:
            return errors.mean()
        return (errors.squeeze(-1) * counted).sum() / counted.sum().clamp_min(1)


def _values(network: TensorDictModule, batch: TensorDictBase) -> Values:
    """The outputs of the network inside, by key: a small network takes less time than the module around it.

    Under autocast they are of fewer bits; targets and errors are not worked out in these.
    """
    outputs = network.module(*(batch[key] for key in network.in_keys))
    return {key: output.float() for key, output in zip(network.out_keys, outputs, strict=True)}


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
        super().__init__({"network": network}, gamma, double, mask_mode, loss_function)
        self.heads = heads

    def forward(self, tensordict: TensorDictBase) -> TensorDict:
        """loss_pick and loss_place of a decoded batch, or of one with its targets."""
        values = self._run("network", tensordict)
        batch = tensordict if PICK_TARGET in tensordict.keys(True) else self.with_targets(tensordict)
        return TensorDict(
            {
                "loss_pick": self._error(values[keys.SLOT_VALUE], batch[keys.SLOT], batch[PICK_TARGET]),
                "loss_place": self._error(values[keys.PLACE_VALUE], batch[keys.PLACE], batch[PLACE_TARGET]),
            }
        )

    @torch.no_grad()
    def with_targets(self, batch: TensorDictBase) -> TensorDict:
        """See `_QLoss.with_targets`."""
        following = batch["next"]
        target, chosen_by = self._bootstrap("network", following)
        best = [
            best_value(target[value], chosen_by[value], following[mask], self.mask_mode)
            for value, mask in ((keys.SLOT_VALUE, keys.SLOT_MASK), (keys.PLACE_VALUE, keys.PLACE_MASK))
        ]
        if self.heads == "mean":
            best = [(best[0] + best[1]) / 2] * 2
        discount = self.gamma * ~following[keys.TERMINATED]
        pick_target, place_target = (following[keys.PLACE_REWARD] + discount * value for value in best)
        kept = batch.select(*self.in_keys, keys.SLOT, keys.PLACE)
        return kept.update({"pick": {"target": pick_target}, "place": {"target": place_target}})


class SequentialLoss(_QLoss):
    """Two networks, Q_p for the pick and Q_l for the place after the lift (eqs. 10-18).

    chain: `natural`: the pick is worth the best place after it, Q_p(s, p) <- max Q_l(s_l, .), and the place
        leads to the next pick, Q_l(s_l, l) <- r + gamma max Q_p(s', .). `literal`: each network bootstraps on
        its own next state, as section 5.2 reads, the pick network with its own reward.
    failed_pick: what Q_l learns where the pick failed and nothing was lifted: `skip`: nothing (section 5.2 ends at
        the pick); `punish`: r_n.
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
    ) -> None:
        super().__init__({"pick": pick, "place": place}, gamma, double, mask_mode, loss_function)
        self.chain = chain
        self.failed_pick = failed_pick

    def forward(self, tensordict: TensorDictBase) -> TensorDict:
        """loss_pick and loss_place of a decoded batch, or of one with its targets."""
        pick_values = self._run("pick", tensordict)[keys.PICK_VALUE]
        place_values = self._run("place", tensordict)[keys.PLACE_VALUE]
        batch = tensordict
        if PICK_TARGET not in batch.keys(True):
            batch = self._with_targets(batch, place_values.detach() if self.double else None)
        counted = batch[PICKED] if self.failed_pick == "skip" else None
        return TensorDict(
            {
                "loss_pick": self._error(pick_values, batch[keys.PICK], batch[PICK_TARGET]),
                "loss_place": self._error(place_values, batch[keys.PLACE], batch[PLACE_TARGET], counted),
            }
        )

    def with_targets(self, batch: TensorDictBase) -> TensorDict:
        """See `_QLoss.with_targets`."""
        return self._with_targets(batch, None)

    @torch.no_grad()
    def _with_targets(self, batch: TensorDictBase, online_place: Tensor | None) -> TensorDict:
        """online_place: the online values of the places, which choose where Q-learning is double."""
        pick_target, place_target = (
            self._natural(batch, online_place) if self.chain == "natural" else self._literal(batch)
        )
        kept = batch.select(*self.in_keys, keys.PICK, keys.PLACE, PICKED)
        return kept.update({"pick": {"target": pick_target}, "place": {"target": place_target}})

    def _natural(self, batch: TensorDictBase, online_place: Tensor | None) -> tuple[Tensor, Tensor]:
        following = batch["next"]
        reward = following[keys.PLACE_REWARD]
        lifted = self._run_target("place", batch)[keys.PLACE_VALUE]
        chosen_by = lifted if online_place is None else online_place
        pick_target = best_value(lifted, chosen_by, batch[keys.PLACE_MASK], self.mask_mode)
        if self.failed_pick == "skip":
            pick_target = torch.where(batch[PICKED][:, None], pick_target, reward)
        discount = self.gamma * ~following[keys.TERMINATED]
        return pick_target, reward + discount * self._next_best("pick", following)

    def _literal(self, batch: TensorDictBase) -> tuple[Tensor, Tensor]:
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
