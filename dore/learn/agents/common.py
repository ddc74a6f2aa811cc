"""What the two agents share: masked greedy heads, exploration, and checks of their hyperparameters."""

from __future__ import annotations

from typing import Protocol

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModule, TensorDictModuleBase
from torch import Tensor
from torchrl.data import Categorical, Composite
from torchrl.modules import EGreedyModule, QValueModule
from torchrl.objectives.common import LossModule

from dore.errors import InputError, flag, number, one_of
from dore.learn import keys
from dore.learn.features import Encoding, mirrored_board, mirrored_cell
from dore.learn.q_loss import MaskMode, masked
from dore.world.episode import Episodes
from dore.world.reach import Reach


class Agent(Protocol):
    """What training and planning need of an agent, whichever structure it has."""

    policy: TensorDictModuleBase
    """The environment's observation -> the actions; explores unless TorchRL's exploration is off."""
    loss: LossModule
    """Losses of a decoded batch; holds the networks' parameters and their targets."""
    networks: torch.nn.ModuleDict
    """The online networks."""
    stored: tuple[str | keys.Key, ...]
    """The keys that the buffer keeps of a step."""

    def decode(self, batch: TensorDictBase) -> TensorDictBase:
        """Stored transitions, with all that the loss needs."""

    def set_epsilon(self, epsilon: float) -> None:
        """How often a head acts at random."""

    def greedy(self, episodes: Episodes) -> tuple[Tensor, Tensor]:
        """The Int64[B] (pick, place) cells that the policy chooses where it does not explore.

        It builds no TensorDict, which would take most of the time of a choice for one board.
        """

    def move_values(self, board: Tensor, target: Tensor, pick: Tensor) -> Tensor:
        """Float[N, G]: the value of picking from Int64[N] cells of Int64[N, W] boards and placing on each cell."""


def check_hyperparameters(
    gamma: float, double: bool, mask_mode: str, encoding: str, loss_function: str, symmetry: bool, reach: Reach
) -> None:
    """Raise InputError for a value outside its domain."""
    flag("agent.double", double)
    if flag("agent.symmetry", symmetry) and reach.mirror is None:
        raise InputError("agent.symmetry: true, but this layout has no mirror image; want false")
    number("agent.gamma", gamma, above=0.0, at_most=1.0)
    one_of("agent.mask_mode", mask_mode, MaskMode)
    one_of("agent.encoding", encoding, Encoding)
    if loss_function not in ("smooth_l1", "l2"):
        raise InputError(f"agent.loss_function: got {loss_function!r}, want smooth_l1 or l2")


def never_empty(mask: Tensor) -> Tensor:
    """Bool[B, n]: rows that allow nothing allow everything: whatever is chosen there fails, as it must."""
    return mask | ~mask.any(-1, keepdim=True)


class Greedy(torch.nn.Module):
    """argmax of the masked values, by TorchRL's QValueModule, then epsilon-greedy over what the mask allows.

    Args:
        action, value, mask: keys of the choice, the Q-values and what is allowed.
        n: the head's outputs.
        device: where the values are.
    """

    def __init__(
        self, action: keys.Key, value: keys.Key, mask: keys.Key, n: int, mask_mode: MaskMode, device: torch.device
    ) -> None:
        super().__init__()
        group, name = action
        masked_value = (group, "masked_value")
        chosen = (group, "chosen_action_value")
        self.mask_values = TensorDictModule(
            lambda values, allowed: masked(values, allowed, mask_mode), in_keys=[value, mask], out_keys=[masked_value]
        )
        self.choose = QValueModule(
            spec=Categorical(n, device=device),
            action_value_key=masked_value,
            out_keys=[action, masked_value, chosen],
            action_space="categorical",
        )
        self.explore = EGreedyModule(
            spec=Composite({group: Composite({name: Categorical(n, device=device)}, device=device)}, device=device),
            action_key=action,
            action_mask_key=mask,
            device=device,
        )

    def modules_in_order(self) -> list[torch.nn.Module]:
        """As a policy runs them."""
        return [self.mask_values, self.choose, self.explore]

    def set_epsilon(self, epsilon: float) -> None:
        """`EGreedyModule.step` loops over frames in Python; setting the value does not."""
        self.explore.eps.fill_(epsilon)


def mirror_rows(
    rows: Tensor, reach: Reach, boards: list[Tensor], cells: list[Tensor]
) -> tuple[list[Tensor], list[Tensor]]:
    """Those Bool[B] rows of the boards and cells mirrored about the robot's axis: the same problem again."""
    mirrored_boards = [torch.where(rows[:, None], mirrored_board(board, reach), board) for board in boards]
    mirrored_cells = [torch.where(rows, mirrored_cell(cell, reach), cell) for cell in cells]
    return mirrored_boards, mirrored_cells
