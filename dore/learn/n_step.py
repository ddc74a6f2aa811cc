"""n-step returns: what an episode's next n moves bring, instead of one move (not in the paper)."""

from __future__ import annotations

import torch
from tensordict import TensorDictBase
from torch import Tensor

from dore.learn import keys


def n_step_rows(rows: TensorDictBase, lengths: Tensor, n: int, gamma: float) -> TensorDictBase:
    """TensorDict[E, T]: the rows of E whole episodes, each with the discounted rewards of its next n moves.

    What is next is the board after these moves, and whether the episode is over there; `keys.STEPS` says how many they
    are, fewer than n where the episode ends before. Moves after the first are those that were made, whatever the
    policy would choose now. (TorchRL's `MultiStep` sums by a convolution, which a GPU may round.)

    Args:
        rows: TensorDict[E, T], one move each; of episode e the first `lengths[e]` count.
        lengths: Int64[E].
    """
    move = torch.arange(rows.shape[1], device=lengths.device)
    last = torch.minimum(move + n, lengths[:, None]).sub(1).clamp_min(0)
    reward = rows["next", *keys.PLACE_REWARD].squeeze(-1)
    returns = torch.zeros_like(reward)
    for k in range(n):
        ahead = reward.gather(1, (move + k).clamp_max(rows.shape[1] - 1).expand_as(reward))
        returns += torch.where(move + k <= last, gamma**k * ahead, 0.0)
    found = rows.clone(recurse=False)
    if len(rows):  # TensorDict gathers nothing from nothing.
        found["next"] = rows["next"].gather(1, last)
        found["next", *keys.PLACE_REWARD] = returns[..., None]
    found[keys.STEPS] = (last - move + 1).clamp_min(0).to(torch.uint8)
    return found
