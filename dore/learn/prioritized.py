"""Prioritised experience replay (Schaul et al., 2016; not in the paper), in plain tensors.

TorchRL's `PrioritizedSampler` needs TorchRL's compiled extension, which does not load beside every version of torch
(pytorch/rl#3508). This one needs none, draws by torch's random state and is kept in checkpoints. Priorities are on
the CPU, wherever the transitions are.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torchrl.data.replay_buffers.samplers import Sampler
from torchrl.data.replay_buffers.storages import Storage

from dore.errors import number

SMALLEST = 1e-8
"""Added to every priority: what was learned perfectly can still be drawn."""


class Prioritized(Sampler):
    """Draws a transition in proportion to its priority to the power of `alpha`; a new one has the highest so far.

    A drawn transition's weight is `p ** -beta`, which makes up for how often it is drawn. The loss is the mean weighted
    by it, as in TorchRL: only the ratios of weights matter, and an update is not made smaller, as it is by Schaul and
    others, who also let beta rise to 1.

    Args:
        alpha: 0: uniform; 1: in proportion to the priority.
        beta: 0: no weights; 1: they make up for all of it.

    Raises:
        InputError: a share outside [0, 1].
    """

    def __init__(self, alpha: float, beta: float) -> None:
        self.alpha = number("buffer.sampler.alpha", alpha, at_least=0.0, at_most=1.0)
        self.beta = number("buffer.sampler.beta", beta, at_least=0.0, at_most=1.0)
        self._empty()

    def _empty(self) -> None:
        self._shares = torch.zeros(0)
        self._highest = 1.0

    def extend(self, index: Tensor) -> None:
        """Give new transitions, at Int64[M] places, the highest priority so far."""
        missing = int(index.max()) + 1 - len(self._shares) if len(index) else 0
        if missing > 0:
            more = max(missing, len(self._shares))  # Doubled, so that filling a buffer copies little.
            self._shares = torch.cat([self._shares, torch.zeros(more)])
        self.update_priority(index, torch.full(index.shape, self._highest))

    def add(self, index: int) -> None:
        """The same for one."""
        self.extend(torch.tensor([index]))

    def update_priority(self, index: Tensor, priority: Tensor, *, storage: Storage | None = None) -> None:
        """Set the priorities Float[M] of the transitions at Int64[M] places."""
        if len(index):
            self._highest = max(self._highest, float(priority.max()))
            self._shares[index.cpu()] = (priority.float().cpu() + SMALLEST) ** self.alpha

    def sample(self, storage: Storage, batch_size: int) -> tuple[Tensor, dict[str, Tensor]]:
        """Int64[M]: places, drawn with replacement; and Float[M] `priority_weight`."""
        shares = self._shares[: len(storage)]
        total = shares.double().cumsum(0)
        drawn = torch.rand(batch_size, dtype=total.dtype) * total[-1]
        index = torch.searchsorted(total, drawn, right=True).clamp_max(len(shares) - 1)
        return index, {"priority_weight": shares[index] ** -self.beta}

    def state_dict(self) -> dict[str, Any]:
        """The priorities."""
        return {"shares": self._shares.clone(), "highest": self._highest}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Continue as the sampler whose `state_dict` this is."""
        self._shares, self._highest = state_dict["shares"].clone(), state_dict["highest"]

    def dumps(self, path: str | Path) -> None:
        """Write the priorities to a file."""
        torch.save(self.state_dict(), path)

    def loads(self, path: str | Path) -> None:
        """Read the priorities from a file."""
        self.load_state_dict(torch.load(path, weights_only=True))


def weighted_mean(loss: Tensor, weights: Tensor) -> Tensor:
    """The mean of Float[B], weighted by Float[B]; 0 where all weights are."""
    return (loss * weights).sum() / weights.sum().clamp_min(torch.finfo(weights.dtype).tiny)
