"""The running mean of the weights, which acts better than the weights of any one update (not in the paper)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel

from dore.errors import InputError, number


def decay_of(value: float | None) -> float | None:
    """A decay of `AveragedWeights`, None for no mean.

    Raises:
        InputError: it is not in (0, 1).
    """
    if value is not None and number("training.averaging", value, above=0.0) >= 1.0:
        raise InputError(f"training.averaging: got {value!r}, want a number below 1, or null")
    return value


class AveragedWeights:
    """An exponential mean of the weights after each update (Polyak and Juditsky, 1992).

    The first updates are averaged over a tenth of their number, so that a short run is not held back by its start.

    Args:
        networks: whose weights change.
        decay: share of the mean that an update leaves, in (0, 1); None: no mean, the weights are used as they are.

    Raises:
        InputError: a decay outside (0, 1).
    """

    def __init__(self, networks: nn.Module, decay: float | None) -> None:
        self.networks = networks
        self._mean: AveragedModel | None = None
        limit = decay_of(decay)
        if limit is None:
            return

        def approach(means: Any, weights: Any, n_averaged: Any) -> None:
            n = float(n_averaged)
            torch._foreach_lerp_(list(means), list(weights), 1.0 - min(limit, (1.0 + n) / (10.0 + n)))

        self._mean = AveragedModel(networks, multi_avg_fn=approach)

    def step(self) -> None:
        """Add the present weights to the mean."""
        if self._mean is not None:
            self._mean.update_parameters(self.networks)

    def weights(self) -> dict[str, Tensor]:
        """State dict of the networks with the mean weights."""
        return (self.networks if self._mean is None else self._mean.module).state_dict()

    @contextmanager
    def acting(self) -> Iterator[None]:
        """Inside the block the networks have the mean weights."""
        if self._mean is None:
            yield
            return
        own = {name: value.clone() for name, value in self.networks.state_dict().items()}
        self.networks.load_state_dict(self._mean.module.state_dict())
        try:
            yield
        finally:
            self.networks.load_state_dict(own)

    def state_dict(self) -> dict[str, Any]:
        """The mean, and the number of updates it covers."""
        return {} if self._mean is None else self._mean.state_dict()

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue as the mean whose `state_dict` this is."""
        if self._mean is not None:
            self._mean.load_state_dict(state)
