"""What the two agents share: hyperparameters, observations, masked greedy heads and exploration."""

from __future__ import annotations

import copy
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, Self

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModule, TensorDictModuleBase, TensorDictSequential
from torch import Tensor
from torchrl.data import Categorical, Composite
from torchrl.modules import EGreedyModule, QValueModule

from dore.configure import call, make
from dore.errors import InputError, flag, number, one_of, whole
from dore.learn import keys
from dore.learn.features import Encoding, encode
from dore.learn.networks import NetworkFactory
from dore.learn.q_loss import MaskMode, QLoss, masked
from dore.world.episode import Episodes
from dore.world.reach import Reach


@dataclass(frozen=True)
class Hyperparameters:
    """What `agent` in a config gives to either structure.

    encoding: see `dore.learn.features.Encoding`.
    mask_mode: see `dore.learn.q_loss.masked`, and the agents.
    gamma: discount of a move.
    double: double Q-learning (the paper's DQN is plain).
    loss_function: smooth_l1 or l2 (the paper's, eq. 3).
    symmetry: learn from each stored move or its mirror image, at random (the paper does not).
    n_steps: the rewards of how many moves make a return; 1: one-step targets, as in the paper.

    Raises:
        InputError: a value outside its domain.
    """

    encoding: Encoding
    mask_mode: MaskMode
    gamma: float
    double: bool
    loss_function: Literal["smooth_l1", "l2"]
    symmetry: bool
    n_steps: int = 1  # Model files up to 0.3 do not name it.

    def __post_init__(self) -> None:
        flag("agent.double", self.double)
        flag("agent.symmetry", self.symmetry)
        whole("agent.n_steps", self.n_steps, 1, at_most=255)
        number("agent.gamma", self.gamma, above=0.0, at_most=1.0)
        one_of("agent.mask_mode", self.mask_mode, MaskMode)
        one_of("agent.encoding", self.encoding, Encoding)
        one_of("agent.loss_function", self.loss_function, Literal["smooth_l1", "l2"])


class Agent(ABC):
    """What training and planning need of an agent, whichever structure it has.

    Args:
        reach: the layout's accessibility check; its device is the agent's.

    Raises:
        InputError: symmetry on a layout without a mirror image.
    """

    policy: TensorDictSequential
    """The environment's observation -> the actions; explores unless TorchRL's exploration is off."""
    loss: QLoss
    """Losses of a decoded batch; holds the networks' parameters and their targets."""
    networks: torch.nn.ModuleDict
    """The online networks."""
    stored: tuple[str | keys.Key, ...]
    """The keys that the buffer keeps of a step."""
    bootstraps = True
    """Whether the loss uses the target networks."""
    choosers: list[Greedy]
    """Steps of the policy: what is picked, where it is placed."""

    def __init__(self, reach: Reach, hyperparameters: Hyperparameters) -> None:
        if hyperparameters.symmetry and reach.mirror is None:
            raise InputError("agent.symmetry: true, but this layout has no mirror image; want false")
        self.reach = reach
        self.encoding, self.mask_mode = hyperparameters.encoding, hyperparameters.mask_mode
        self.symmetry, self.n_steps = hyperparameters.symmetry, hyperparameters.n_steps

    @property
    def serves_every_layout(self) -> bool:
        """Whether the weights do not depend on the layout."""
        return all(getattr(network, "serves_every_layout", False) for network in self.networks.values())

    def on(self, reach: Reach) -> Self:
        """This agent on another layout or reach, with the same parameters; its networks must serve every layout."""
        other = copy.copy(self)
        other.reach = reach
        moved = {name: network.on(reach) for name, network in self.networks.items()}  # type: ignore[operator]
        other.networks = torch.nn.ModuleDict(moved)
        modules = other._q_modules()
        other.loss = self.loss.of(modules)
        other._make_policy(modules)
        return other

    @abstractmethod
    def _q_modules(self) -> dict[str, TensorDictModule]:
        """The networks over TensorDicts, by the names that the loss has for them."""

    @abstractmethod
    def _make_policy(self, modules: dict[str, TensorDictModule]) -> None:
        """Act by these on this reach's cells."""

    @abstractmethod
    def decode(self, batch: TensorDictBase) -> TensorDictBase:
        """Stored transitions, with all that the loss needs."""

    @abstractmethod
    def pick_values(self, board: Tensor, target: Tensor) -> Tensor:
        """Float[N, G]: the value of picking from each cell of boards Int64[N, W]; of an empty one it means nothing."""

    @abstractmethod
    def move_values(self, board: Tensor, target: Tensor, pick: Tensor) -> Tensor:
        """Float[N, G]: the value of picking from Int64[N] cells of Int64[N, W] boards and placing on each cell."""

    def greedy(self, episodes: Episodes) -> tuple[Tensor, Tensor]:
        """The Int64[B] (pick, place) cells that the policy chooses where it does not explore.

        It takes the policy's steps without TensorDicts, which would take most of the time of a choice for one board.
        """
        found = {
            keys.BOARD: episodes.board,
            keys.TARGET: episodes.target,
            keys.VISITED: episodes.visited,
            keys.PICKABLE: episodes.legal.pickable,
            keys.LEGAL_PICK: episodes.legal.pick,
        }
        for step in self.policy.module:
            if isinstance(step, Greedy):
                found[step.action] = step.best(found[step.value], found[step.mask])
            else:
                found.update(zip(step.out_keys, step.module(*(found[key] for key in step.in_keys)), strict=True))
        return found[keys.PICK], found[keys.PLACE]

    def _set_policy(self, *steps: TensorDictModuleBase) -> None:
        """Act by these steps, each from what is observed or found before to keys of its own."""
        self.policy = TensorDictSequential(*steps)
        self.choosers = [step for step in steps if isinstance(step, Greedy)]

    def set_epsilon(self, epsilon: float) -> None:
        """How often a head acts at random; `EGreedyModule.step` would loop over frames in Python."""
        for chooser in self.choosers:
            chooser.explore.eps.fill_(epsilon)

    def _observe(self, board: Tensor, target: Tensor, mask: Tensor | None) -> Tensor:
        """Float[B, C, G]: what a network sees."""
        return encode(self.reach, board, target, mask, self.encoding)


def agent_from_config(config: Mapping[str, Any], reach: Reach) -> Agent:
    """The agent that the groups `agent` and `network` of a config describe, with fresh weights."""
    network = partial(_network_of, make(config.get("network"), "network"))
    agent: Agent = make(config.get("agent"), "agent", reach=reach, network=network)
    return agent


def _network_of(factory: NetworkFactory, **given: Any) -> torch.nn.Module:
    """A network; where a factory wants `layout`, as in versions up to 0.2, the error says what it gets instead."""
    try:
        network: torch.nn.Module = call(factory, "network", **given)
        _check_outputs(network, **given)
    except InputError as error:
        if re.search(r"argument:? '(reach|layout)'", str(error)):
            wanted = "want a class made by (reach, n_planes, n_outputs, ...); reach.layout is the layout"
            raise InputError(f"{error}; {wanted}") from None
        raise
    return network


@torch.no_grad()
def _check_outputs(network: torch.nn.Module, reach: Reach, n_planes: int, n_outputs: Sequence[int]) -> None:
    """Raise InputError where a network does not return one Float[B, n] for each n of `n_outputs`, as a tuple."""
    given, name = (1, n_planes, reach.n_cells), type(network).__name__
    wanted = [(1, n) for n in n_outputs]
    parameter = next(network.parameters(), torch.zeros(0))
    network.eval()  # A norm over the batch takes no single row while it learns.
    try:
        found = network(torch.zeros(given, device=parameter.device))
    except (RuntimeError, TypeError, ValueError, IndexError) as error:
        raise InputError(f"network: {name} cannot take planes {list(given)} ({str(error).splitlines()[0]})") from None
    network.train()
    shapes = [tuple(one.shape) for one in found] if isinstance(found, tuple) else type(found).__name__
    if shapes != wanted:
        raise InputError(f"network: {name} returns {shapes} of planes {list(given)}, want a tuple of shapes {wanted}")


def never_empty(mask: Tensor) -> Tensor:
    """Bool[B, n]: rows that allow nothing allow everything: whatever is chosen there fails, as it must."""
    return mask | ~mask.any(-1, keepdim=True)


class Greedy(TensorDictSequential):
    """argmax of the masked values, by TorchRL's QValueModule, then epsilon-greedy over what the mask allows.

    Args:
        action, value, mask: keys of the choice, the Q-values and what is allowed.
        n: the head's outputs.
        device: where the values are.
    """

    def __init__(
        self, action: keys.Key, value: keys.Key, mask: keys.Key, n: int, mask_mode: MaskMode, device: torch.device
    ) -> None:
        self.action, self.value, self.mask, self.mask_mode = action, value, mask, mask_mode
        group, name = action
        masked_value = (group, "masked_value")
        spec = Categorical(n, device=device)
        explore = EGreedyModule(
            spec=Composite({group: Composite({name: spec}, device=device)}, device=device),
            action_key=action,
            action_mask_key=mask,
            device=device,
        )
        super().__init__(
            TensorDictModule(
                lambda values, allowed: masked(values, allowed, mask_mode),
                in_keys=[value, mask],
                out_keys=[masked_value],
            ),
            QValueModule(
                spec=spec,
                action_value_key=masked_value,
                out_keys=[action, masked_value, (group, "chosen_action_value")],
                action_space="categorical",
            ),
            explore,
        )
        self.explore = explore

    def best(self, values: Tensor, mask: Tensor) -> Tensor:
        """Int64[B]: the choice that is not explored, of Float[B, n] Q-values under Bool[B, n]."""
        return masked(values, mask, self.mask_mode).argmax(-1)
