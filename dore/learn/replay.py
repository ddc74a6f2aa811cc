"""Transitions as the buffer keeps them: packed boards and small integers, decoded by the agent after sampling.

K denotes the points at which updates are made, n the transitions drawn at each.
"""

from __future__ import annotations

import io
import zlib
from collections.abc import Sequence
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import RandomSampler, ReplayBuffer

from dore.errors import InputError
from dore.learn import keys
from dore.learn.prioritized import Prioritized


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


def check_uniform(buffer: ReplayBuffer, why: str = "") -> None:
    """Raise InputError where a buffer's sampler is not uniform."""
    if type(buffer.sampler) is not RandomSampler:
        got = type(buffer.sampler).__name__
        raise InputError(f"buffer.sampler: got {got}, want RandomSampler{why}")


def has_priorities(buffer: ReplayBuffer) -> bool:
    """Whether it draws what was learned worst more often."""
    return isinstance(buffer.sampler, Prioritized)


def draw(buffer: ReplayBuffer, n: int) -> TensorDictBase:
    """TensorDict[n]; from a prioritised buffer with where each row is, and its weight."""
    sample: TensorDictBase
    if not has_priorities(buffer):
        sample = buffer.sample(n)
        return sample
    sample, drawn = buffer.sample(n, return_info=True)
    device = sample.device or "cpu"
    sample[keys.INDEX], sample[keys.WEIGHT] = drawn["index"].to(device), drawn["priority_weight"].to(device)
    return sample


def draw_in_order(buffer: ReplayBuffer, rows: TensorDictBase, stored: Tensor, n: int) -> TensorDictBase:
    """TensorDict[K * n]: what storing and drawing by turns would draw; nothing is stored yet.

    The k-th draw is uniform over what the buffer holds once the first `stored[k]` (Int64[K]) of the rows are in it:
    the same as `extend` and `sample` in turn, for a few gathers in all instead of several for each draw.

    Raises:
        InputError: the buffer samples otherwise than uniformly.
    """
    check_uniform(buffer)
    held, capacity = len(buffer), buffer.storage.max_size
    size = (held + stored).clamp_max(capacity)[:, None]
    age = (torch.rand(len(stored), n, dtype=torch.float64) * size).long().clamp_max(size - 1)
    # Counted from the first new row on; what the buffer holds already has a negative place.
    place = (stored[:, None] - 1 - age).flatten().to(rows.device)
    new = place >= 0
    if not held:
        return rows[place]
    drawn: TensorDictBase = buffer.storage[(_cursor(buffer) + place.clamp_max(-1)) % capacity]
    if bool(new.any()):
        drawn[new] = rows[place[new]]
    return drawn


def _cursor(buffer: ReplayBuffer) -> int:
    """Where the buffer writes next."""
    return int(buffer.writer.state_dict()["_cursor"])


def tensors_of(rows: TensorDictBase) -> dict[str, Tensor]:
    """The leaves of a TensorDict by name, as a checkpoint keeps them: torch saves all that a view is of."""
    return dict(sorted(rows.flatten_keys(".").clone().items()))


def rows_of(tensors: dict[str, Tensor], batch_dims: int = 1) -> TensorDict:
    """The TensorDict whose `tensors_of` these are."""
    shape = next(iter(tensors.values())).shape[:batch_dims]
    return TensorDict(tensors, batch_size=shape).unflatten_keys(".")


def buffer_state(buffer: ReplayBuffer) -> dict[str, Any]:
    """The transitions a buffer holds, and where it writes next; its own state holds its empty places too."""
    if not len(buffer):
        return {"rows": {}, "writer": {}}
    state = {"rows": _packed(tensors_of(buffer[:])), "writer": buffer.writer.state_dict()}
    return state | ({"sampler": buffer.sampler.state_dict()} if has_priorities(buffer) else {})


def load_buffer(buffer: ReplayBuffer, state: dict[str, Any]) -> None:
    """Fill an empty buffer as the one whose `buffer_state` this is."""
    rows = state["rows"]
    if not len(rows):
        return
    # Those of version 0.1 are not packed.
    buffer.extend(rows_of(rows if isinstance(rows, dict) else _unpacked(rows)))
    buffer.writer.load_state_dict(state["writer"])
    if has_priorities(buffer):
        buffer.sampler.load_state_dict(state["sampler"])


def _packed(tensors: dict[str, Tensor]) -> Tensor:
    """Uint8[n]: tensors by name, compressed: boards have more bits than a layout has cells, and rewards few values."""
    data = io.BytesIO()
    torch.save(tensors, data)
    return torch.frombuffer(bytearray(zlib.compress(data.getbuffer(), 1)), dtype=torch.uint8)


def _unpacked(data: Tensor) -> dict[str, Tensor]:
    """The tensors whose `_packed` this is, on the CPU."""
    raw = io.BytesIO(zlib.decompress(data.numpy().tobytes()))
    tensors: dict[str, Tensor] = torch.load(raw, map_location="cpu", weights_only=True)
    return tensors
