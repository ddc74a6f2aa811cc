"""Where tensors lie."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dore.errors import InputError

if TYPE_CHECKING:
    import torch


def device_of(name: torch.device | str) -> torch.device:
    """A device that is there.

    Raises:
        InputError: no such device on this machine.
    """
    import torch

    try:
        device = torch.device(name)
    except (RuntimeError, TypeError):
        raise InputError(f"device: got {name!r}, want cpu, cuda or cuda:N") from None
    if device.type == "cuda" and (device.index or 0) >= torch.cuda.device_count():
        raise InputError(f"device: {name!r} is not on this machine, which has {torch.cuda.device_count()} CUDA devices")
    return device
