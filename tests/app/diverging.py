"""An optimiser that makes a training diverge, which no config does within its bounds."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch


class Diverging(torch.optim.Adam):
    """Adam, after whose steps at a learning rate of 10 no weight is finite."""

    def step(self, closure: Callable[[], float] | None = None) -> Any:  # type: ignore[override]
        loss = super().step(closure)
        for group in self.param_groups:
            if group["lr"] == 10:
                for weights in group["params"]:
                    weights.data.fill_(torch.inf)
        return loss
