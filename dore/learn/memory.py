"""Running out of memory, said in one line with the key to lower."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch

from dore.errors import InputError

# The messages of torch's CPU allocator on Linux and elsewhere, and of the C library.
REFUSALS = ("can't allocate memory", "not enough memory", "Cannot allocate memory")


class NotEnoughMemory(InputError):
    """Something in the config takes more memory than there is: names the key to lower, and its value."""


@contextmanager
def memory_for(key: str, value: object) -> Iterator[None]:
    """What the block allocates grows with a config's key.

    Raises:
        NotEnoughMemory: it did not fit, on the CPU or on a CUDA device.
    """
    try:
        yield
    except (MemoryError, RuntimeError) as error:
        refused = isinstance(error, MemoryError | torch.OutOfMemoryError) or any(
            word in str(error) for word in REFUSALS
        )
        if not refused:
            raise
        raise NotEnoughMemory(f"{key}: {value} takes more memory than there is, want less") from None
