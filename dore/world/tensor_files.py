"""Named tensors with a text header, as safetensors: written whole, checked on reading."""

from __future__ import annotations

import os

from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from dore.errors import InputError
from dore.files import atomic_write


def write_tensors(path: str | os.PathLike[str], tensors: dict[str, Tensor], header: dict[str, str]) -> None:
    """Replace the file at `path` by these tensors; `header` must name their "format"."""
    data = save({name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}, header)
    with atomic_write(path, "wb") as file:
        file.write(data)


def read_tensors(path: str | os.PathLike[str], wanted_format: str) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Tensors, on the CPU, and header.

    Raises:
        InputError: no such file, a damaged one, or one of another format.
    """
    try:
        with safe_open(os.fspath(path), framework="pt") as file:
            header = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (SafetensorError, OSError) as error:
        raise InputError(f"{path}: cut off or damaged ({str(error).splitlines()[0]})") from None
    if header.get("format") != wanted_format:
        raise InputError(f"{path}: format {header.get('format')!r}, want {wanted_format}")
    return tensors, header
