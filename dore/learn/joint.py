"""The environment as TorchRL's stock losses expect it: one observation, one action, its mask, one reward."""

from __future__ import annotations

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.data import Binary, Categorical, Composite, Unbounded
from torchrl.envs import Transform

from dore.learn import keys
from dore.learn.features import Encoding, encode, n_planes
from dore.world.reach import Reach
from dore.world.rules import legal_places

ACTION_MASK = "action_mask"


class Joint(Transform):
    """Adds `observation` Float[B, C * G], `action_mask` Bool[B, G * G] and `reward` Float[B, 1], and takes `action`.

    An action is Int64[B], pick * G + place; the mask is exact, so a masked policy never fails by a move. The reward is
    that of the whole move, ("place", "reward"). For a `dore.learn.env.RearrangeEnv`:
    `TransformedEnv(env, Joint(env.reach))`.

    Args:
        reach: the environment's.
        encoding: what is observed of a board; with it goes the mask of the obstacles that can be reached.
    """

    def __init__(self, reach: Reach, encoding: Encoding = "planes") -> None:
        super().__init__()
        self.reach, self.encoding = reach, encoding

    def _call(self, next_tensordict: TensorDictBase) -> TensorDictBase:
        board, target, pickable = (next_tensordict[key] for key in (keys.BOARD, keys.TARGET, keys.PICKABLE))
        next_tensordict[keys.OBSERVATION] = encode(self.reach, board, target, pickable, self.encoding).flatten(1)
        next_tensordict[ACTION_MASK] = self._mask(board, target, next_tensordict[keys.VISITED], pickable)
        if keys.PLACE_REWARD in next_tensordict.keys(include_nested=True):
            next_tensordict["reward"] = next_tensordict[keys.PLACE_REWARD]
        return next_tensordict

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        return self._call(tensordict_reset)

    def _mask(self, board: Tensor, target: Tensor, visited: Tensor, pickable: Tensor) -> Tensor:
        """Bool[B, G * G]: the pairs that are legal. Where none is, the episode has ended, and all may be chosen."""
        cells = self.reach.n_cells
        row, pick = pickable.nonzero(as_tuple=True)
        mask = torch.zeros(len(board), cells, cells, dtype=torch.bool, device=board.device)
        mask[row, pick] = legal_places(self.reach, board[row], target[row], visited[row], pick)
        mask = mask.flatten(1)
        return mask | ~mask.any(-1, keepdim=True)

    def _inv_call(self, tensordict: TensorDictBase) -> TensorDictBase:
        action = tensordict.get("action", None)
        if action is not None:
            tensordict[keys.PICK], tensordict[keys.PLACE] = action // self.reach.n_cells, action % self.reach.n_cells
        return tensordict

    def transform_input_spec(self, input_spec: Composite) -> Composite:
        """`action` takes the place of the two cells."""
        batch, device = input_spec.shape, input_spec.device
        action = Categorical(self.reach.n_cells**2, shape=batch, device=device)
        input_spec["full_action_spec"] = Composite(action=action, shape=batch, device=device)
        return input_spec

    def transform_output_spec(self, output_spec: Composite) -> Composite:
        """What is added."""
        batch, device, cells = output_spec.shape, output_spec.device, self.reach.n_cells
        planes = n_planes(self.encoding, with_mask=True)
        observed, rewards = output_spec["full_observation_spec"], output_spec["full_reward_spec"]
        observed[keys.OBSERVATION] = Unbounded((*batch, planes * cells), device=device)
        observed[ACTION_MASK] = Binary(cells**2, (*batch, cells**2), device=device, dtype=torch.bool)
        rewards["reward"] = Unbounded((*batch, 1), device=device)
        return output_spec
