"""What the losses of both DQN structures share: masked greedy values, target networks, reduction and priorities.

B denotes the batch, n the outputs of a head.

The online values come from the networks themselves. Only the targets go through TorchRL's functional parameters, whose
overhead is as large as a small network.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, Self

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule, dispatch
from tensordict.utils import NestedKey
from torch import Tensor
from torchrl.objectives.common import LossModule
from torchrl.objectives.utils import ValueEstimators, distance_loss

from dore.errors import number
from dore.learn import keys
from dore.learn.prioritized import weighted_mean

MaskMode = Literal["legal", "literal"]
FailedPick = Literal["skip", "punish"]
Values = dict[str | keys.Key, Tensor]
PICK_TARGET, PLACE_TARGET = ("pick", "target"), ("place", "target")
"""Float[B, 1]: the temporal-difference target of each chosen action."""


def masked(values: Tensor, mask: Tensor, mode: MaskMode) -> Tensor:
    """Q-values Float[B, n] whose argmax is the greedy choice under Bool[B, n].

    `legal`: illegal entries become the lowest float. `literal`: Q x mask (eqs. 14, 18), where an illegal entry
    counts 0 and so beats legal negative ones.
    """
    if mode == "literal":
        return values * mask
    return values.masked_fill(~mask, torch.finfo(values.dtype).min)


def best_value(values: Tensor, chosen_by: Tensor, mask: Tensor, mode: MaskMode) -> Tensor:
    """Float[B, 1]: the value of the greedy choice of `chosen_by`; 0 where nothing is legal.

    `chosen_by` is `values` itself for plain Q-learning, the online network's values for double Q-learning.
    """
    choice = masked(chosen_by, mask, mode).argmax(-1, keepdim=True)
    value = values.gather(-1, choice)
    if mode == "literal":
        value = value * mask.gather(-1, choice)
    return torch.where(mask.any(-1, keepdim=True), value, 0.0)


class QLoss(LossModule):
    """Temporal-difference loss of a pick head and a place head, by TorchRL's conventions.

    `forward` returns `out_keys`, and writes each row's squared error, summed over both heads, to the input under
    `tensor_keys.priority` for prioritised replay. Importance weights under `tensor_keys.priority_weight` are applied.
    Neither for a batch whose targets were computed ahead (`with_targets`).

    Args:
        online: the networks by name; each becomes functional, with target parameters.
        gamma: discount of a move.
        double: double Q-learning.
        mask_mode: see `masked`.
        loss_function: `l2` or `smooth_l1`.
        failed_pick: what the place head learns where the pick failed and nothing was placed: `skip`: nothing;
            `punish`: r_n.
        reduction: `mean`, `sum` or `none`.
    """

    @dataclass
    class _AcceptedKeys:
        """The keys that `set_keys` can change; see `dore.learn.keys` for shapes."""

        pick_action: NestedKey = keys.PICK
        pick_value: NestedKey = keys.PICK_VALUE
        pick_mask: NestedKey = keys.PICK_MASK
        pick_reward: NestedKey = keys.PICK_REWARD
        place_action: NestedKey = keys.PLACE
        place_value: NestedKey = keys.PLACE_VALUE
        place_mask: NestedKey = keys.PLACE_MASK
        place_reward: NestedKey = keys.PLACE_REWARD
        terminated: NestedKey = keys.TERMINATED
        picked: NestedKey = keys.PICKED
        priority: NestedKey = keys.ERROR
        priority_weight: NestedKey = keys.WEIGHT

    tensor_keys: Any
    default_keys: type = _AcceptedKeys
    default_value_estimator = ValueEstimators.TD0
    out_keys = ["loss_pick", "loss_place"]  # noqa: RUF012 (as every TorchRL loss declares it)

    def __init__(
        self,
        online: Mapping[str, TensorDictModule],
        gamma: float,
        double: bool,
        mask_mode: MaskMode,
        loss_function: str,
        failed_pick: FailedPick,
        reduction: str,
    ) -> None:
        super().__init__()
        self.failed_pick = failed_pick
        self.gamma = gamma
        self.double = double
        self.mask_mode = mask_mode
        self.loss_function = loss_function
        self.reduction = reduction
        for name, network in online.items():
            self.convert_to_functional(network, name, create_target_params=True)
        # Not as submodules: `convert_to_functional` has registered their parameters already.
        self.__dict__["_online"] = dict(online)
        self._observations = [key for network in online.values() for key in network.in_keys]

    def of(self, online: Mapping[str, TensorDictModule]) -> Self:
        """This loss, with the same parameters and targets, of the same networks on another reach."""
        other = copy.copy(self)
        other.__dict__.update(online, _online=dict(online))
        return other

    def restart_targets(self) -> None:
        """Make the target networks what the online ones are."""
        for name in self._online:
            getattr(self, f"target_{name}_params").data.update_(getattr(self, f"{name}_params").data)

    @property
    def in_keys(self) -> list[NestedKey]:
        """The keys that `forward` reads; `dispatch` names its arguments after them."""
        return list(dict.fromkeys(self._keys_read()))

    def _keys_read(self) -> list[NestedKey]:
        raise NotImplementedError

    def make_value_estimator(self, value_type: ValueEstimators | None = None, **hyperparams: float) -> QLoss:
        """Set `gamma`. The targets are one-step (TD(0)) by construction, or of as many moves as a row says.

        Raises:
            NotImplementedError: another estimator than TD(0).
            TypeError: another hyperparameter than gamma.
        """
        if value_type not in (None, ValueEstimators.TD0):
            raise NotImplementedError(f"{type(self).__name__} computes one-step targets: want TD0, got {value_type}")
        if unknown := set(hyperparams) - {"gamma"}:
            raise TypeError(f"{type(self).__name__}.make_value_estimator: {', '.join(sorted(unknown))} is not gamma")
        self.gamma = number("gamma", hyperparams.get("gamma", self.gamma), above=0.0, at_most=1.0)
        self.value_type = ValueEstimators.TD0
        return self

    @dispatch
    def forward(self, tensordict: TensorDictBase) -> TensorDict:
        """loss_pick and loss_place of a decoded batch, or of one with its targets."""
        return self.losses_of(tensordict, self.online_values(tensordict))

    def online_values(self, batch: TensorDictBase) -> Values:
        """The values of all heads, by their keys."""
        found: Values = {}
        for name in self._online:
            found |= self._run(name, batch)
        return found

    def losses_of(self, tensordict: TensorDictBase, online: Values) -> TensorDict:
        """`forward`, where the online values are known."""
        ahead = PICK_TARGET in tensordict.keys(True)
        return self._losses(tensordict, tensordict if ahead else self._with_targets(tensordict, online), online)

    def with_targets(self, batch: TensorDictBase) -> TensorDict:
        """What `forward` needs of a decoded batch, targets included.

        For many updates between which the target networks do not change: one large pass instead of many small ones.

        Raises:
            ValueError: Q-learning is double, so targets change with the online networks.
        """
        if self.double:
            raise ValueError("with_targets: not for double Q-learning, whose targets change with each update")
        return self._with_targets(batch, {})

    @torch.no_grad()
    def _with_targets(self, batch: TensorDictBase, online: Values) -> TensorDict:
        names = self.tensor_keys
        pick_target, place_target = self._targets(batch, online)
        kept = batch.select(*self._observations, names.pick_action, names.place_action)
        if self.failed_pick == "skip":
            kept[names.picked] = batch[names.picked]
        return kept.update({"pick": {"target": pick_target}, "place": {"target": place_target}})

    def _targets(self, batch: TensorDictBase, online: Values) -> tuple[Tensor, Tensor]:
        """Float[B, 1] of the pick and the place; online: the online values of the batch where Q-learning is double."""
        raise NotImplementedError

    def _discount(self, following: TensorDictBase) -> Tensor:
        """Float[B, 1]: of what follows; 0 where the episode ends."""
        steps = following.get(keys.STEPS, default=None)
        gamma = self.gamma if steps is None else self.gamma ** steps[:, None]
        return gamma * ~following[self.tensor_keys.terminated]

    def _run(self, name: str, batch: TensorDictBase) -> Values:
        """The online network's values."""
        return _values(self._online[name], batch)

    def _run_target(self, name: str, batch: TensorDictBase) -> Values:
        """The target network's values."""
        network: TensorDictModule = getattr(self, name)
        with getattr(self, f"target_{name}_params").to_module(network, preserve_module_state=False):
            return _values(network, batch)

    def _bootstrap(self, name: str, batch: TensorDictBase) -> tuple[Values, Values]:
        """Target values, and those that choose the action."""
        target = self._run_target(name, batch)
        return target, self._run(name, batch) if self.double else target

    def _best(self, head: str, target: Values, chosen_by: Values, masks: TensorDictBase) -> Tensor:
        """`best_value` of the pick head or the place head."""
        value, mask = getattr(self.tensor_keys, f"{head}_value"), getattr(self.tensor_keys, f"{head}_mask")
        return best_value(target[value], chosen_by[value], masks[mask], self.mask_mode)

    def _losses(self, tensordict: TensorDictBase, batch: TensorDictBase, values: Values) -> TensorDict:
        """`out_keys` from the heads' values Float[B, n]; the priorities go to `tensordict`."""
        names = self.tensor_keys
        counted = batch[names.picked] if self.failed_pick == "skip" else None
        # Of targets computed ahead nobody wants priorities: what is drawn for many updates is drawn uniformly.
        prioritised = batch is not tensordict
        weights = tensordict.get(names.priority_weight, default=None) if prioritised else None
        pick = values[names.pick_value].gather(-1, batch[names.pick_action][:, None])
        place = values[names.place_value].gather(-1, batch[names.place_action][:, None])
        pick_target, place_target = batch[PICK_TARGET], batch[PLACE_TARGET]
        if prioritised:
            with torch.no_grad():
                place_error = (place - place_target).square()
                if counted is not None:
                    place_error = place_error * counted[:, None]
                tensordict.set(names.priority, (pick - pick_target).square() + place_error)
        losses = [
            distance_loss(value, target, self.loss_function).squeeze(-1)
            for value, target in ((pick, pick_target), (place, place_target))
        ]
        if weights is not None and counted is not None and self.reduction == "mean":
            loss_place = weighted_mean(losses[1], weights * counted)  # TorchRL's is NaN where no row counts.
        else:
            loss_place = self._reduce_loss(losses[1], mask=counted, weights=weights)
        return TensorDict(loss_pick=self._reduce_loss(losses[0], weights=weights), loss_place=loss_place)


def _values(network: TensorDictModule, batch: TensorDictBase) -> Values:
    """The outputs of the network inside, by key: a small network costs less than the module around it.

    Under autocast the outputs have fewer bits; targets and errors are computed in float32.
    """
    outputs = network.module(*(batch[key] for key in network.in_keys))
    return {key: output.float() for key, output in zip(network.out_keys, outputs, strict=True)}
