"""Transitions as the buffer keeps them: packed boards and small integers, decoded by the agent after sampling."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from tensordict import TensorDict, TensorDictBase

from dore import keys


def compact(step: TensorDictBase, stored: Sequence[str | keys.Key], n_cells: int) -> TensorDict:
    """The stored keys of TensorDict[B] steps, cells and slots in the smallest integer that holds them.

    Up to 64 cells a transition takes 24 bytes: two boards of 8, target, pick and place of 1 each, a reward of
    4 and a flag of 1 (4 more where the pick has a reward of its own).
    """
    small = torch.uint8 if n_cells <= 256 else torch.int16
    kept = step.select(*stored).clone()
    for key in (keys.TARGET, keys.PICK, keys.SLOT, keys.PLACE):
        if key in stored:
            kept[key] = kept[key].to(small)
    return kept


def restore(sample: TensorDictBase) -> TensorDictBase:
    """A sample with its cells and slots as Int64 again."""
    for key in (keys.TARGET, keys.PICK, keys.SLOT, keys.PLACE):
        if key in sample.keys(include_nested=True):
            sample[key] = sample[key].long()
    return sample
