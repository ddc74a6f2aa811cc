"""Transitions as the buffer keeps them: packed boards and small integers, decoded by the agent after sampling."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.data import ReplayBuffer

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


def buffer_state(buffer: ReplayBuffer) -> dict[str, Any]:
    """The transitions a buffer holds, and where it writes next; its own state holds its empty places too."""
    if not len(buffer):
        return {"rows": {}, "writer": {}}
    rows = buffer[:].flatten_keys(".")
    return {"rows": dict(rows.items()), "writer": buffer.writer.state_dict()}


def load_buffer(buffer: ReplayBuffer, state: dict[str, Any]) -> None:
    """Fill an empty buffer as the one whose `buffer_state` this is."""
    if not state["rows"]:
        return
    n = len(next(iter(state["rows"].values())))
    buffer.extend(TensorDict(state["rows"], batch_size=[n]).unflatten_keys("."))
    buffer.writer.load_state_dict(state["writer"])
