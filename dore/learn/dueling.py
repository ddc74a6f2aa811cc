"""Dueling heads (Wang et al., 2016; not in the paper), around any network."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self

from torch import Tensor, nn

from dore.configure import call
from dore.errors import InputError, shown
from dore.learn.networks import NetworkFactory
from dore.world.reach import Reach


class Dueling(nn.Module):
    """A state value plus each choice's advantage over the mean: Q = V + A - mean A, for each head.

    The body has two heads for each of its own; the mean of the second one's outputs is V, so that a body with one
    output a cell serves too.

    Args:
        body: makes the network inside.

    Raises:
        InputError: no body, or one that does not fit.
    """

    def __init__(self, reach: Reach, n_planes: int, n_outputs: Sequence[int], body: NetworkFactory) -> None:
        super().__init__()
        if not callable(body):
            raise InputError(f"network.body: got {shown(body)}, want a network (network@network.body=mlp)")
        doubled = [n for n in n_outputs for _ in range(2)]
        self.body: Any = call(body, "network.body", reach=reach, n_planes=n_planes, n_outputs=doubled)

    @property
    def serves_every_layout(self) -> bool:
        """Whether the weights do not depend on the layout: where the body's do not."""
        return bool(getattr(self.body, "serves_every_layout", False))

    def on(self, reach: Reach) -> Self:
        """This network on another reach, with the same parameters."""
        other = self.__new__(type(self))
        nn.Module.__init__(other)
        other.body = self.body.on(reach)
        return other

    def forward(self, planes: Tensor) -> tuple[Tensor, ...]:
        """Float[B, C, G] -> Float[B, n] for each head."""
        found = self.body(planes)
        pairs = zip(found[::2], found[1::2], strict=True)
        return tuple(
            advantage - advantage.mean(-1, keepdim=True) + value.mean(-1, keepdim=True) for advantage, value in pairs
        )
