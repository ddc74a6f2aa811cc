"""n-step returns: what an episode's next n moves bring, instead of one move (not in the paper)."""

from __future__ import annotations

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.data import MultiStep

from dore.learn import keys


def n_step_rows(rows: TensorDictBase, lengths: Tensor, n: int, gamma: float) -> TensorDictBase:
    """TensorDict[E, T]: the rows of E whole episodes, each with the discounted rewards of its next n moves.

    What is next is the board after these moves, and whether the episode is over there; `keys.STEPS` says how many they
    are, fewer than n where the episode ends before. Moves after the first are those that were made, whatever the
    policy would choose now.

    Args:
        rows: TensorDict[E, T], one move each; of episode e the first `lengths[e]` count.
        lengths: Int64[E].
    """
    if not len(rows):
        return rows.set(keys.STEPS, torch.zeros(rows.shape, dtype=torch.uint8, device=lengths.device))
    lookahead = MultiStep(gamma, n)
    lookahead.reward_keys, lookahead.done_keys = (keys.PLACE_REWARD,), ()
    rows = rows.clone(recurse=False)
    rows["next"] = rows["next"].clone(recurse=False)
    last = torch.arange(rows.shape[1], device=lengths.device) == lengths[:, None] - 1
    rows["next", keys.DONE] = last[..., None]
    found: TensorDictBase = lookahead(rows)
    found[keys.STEPS] = found["steps_to_next_obs"].to(torch.uint8)
    return found.select(*_kept(rows), keys.STEPS)


def _kept(rows: TensorDictBase) -> list[keys.Key]:
    return [key for key in rows.keys(True, True) if key != ("next", keys.DONE)]
