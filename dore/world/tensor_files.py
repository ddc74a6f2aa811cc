"""Named tensors with a text header (safetensors). Reading checks everything; writing replaces the file whole."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Literal

from safetensors import SafetensorError, safe_open

from dore.errors import InputError, shown
from dore.files import atomic_write

if TYPE_CHECKING:  # A header is read without it.
    from torch import Tensor


def write_tensors(path: str | os.PathLike[str], tensors: dict[str, Tensor], header: dict[str, str]) -> None:
    """Replace the file at `path` by these tensors; `header` must name their "format"."""
    from safetensors.torch import save

    plain = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    data = save(plain, {**header, "digest": _digest(plain, header)})
    with atomic_write(path, "wb") as file:
        file.write(data)


def read_tensors(path: str | os.PathLike[str], wanted_format: str) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Tensors, on the CPU, and header. Files of version 0.1 have no digest.

    Raises:
        InputError: no such file, a damaged one, one of another format, or a number that is not finite; does not name
            the file, which `named` does.
    """
    with opened(path, "pt", wanted_format) as (file, header):
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    if header.pop("digest", None) not in (None, _digest(tensors, header)):
        raise InputError("cut off or damaged (its digest is not that of its content)")
    for name, tensor in tensors.items():
        if tensor.is_floating_point() and not bool(tensor.isfinite().all()):
            raise InputError(f"{name}: holds numbers that are not finite, want finite ones")
    return tensors, header


@contextmanager
def opened(
    path: str | os.PathLike[str], framework: Literal["pt", "np"], wanted_format: str
) -> Iterator[tuple[Any, dict[str, str]]]:
    """An open file and its header; torch is loaded where the framework is "pt".

    Raises:
        InputError: as `read_tensors`, but for the numbers; also what the block cannot read.
    """
    try:
        with safe_open(os.fspath(path), framework=framework) as file:
            header = file.metadata() or {}
            if header.get("format") != wanted_format:
                raise InputError(f"format {shown(header.get('format'))}, want {wanted_format}")
            yield file, header
    except FileNotFoundError:
        raise InputError("no such file") from None
    except (SafetensorError, OSError) as error:
        raise InputError(f"cut off or damaged ({str(error).splitlines()[0]})") from None


def _digest(tensors: dict[str, Tensor], header: dict[str, str]) -> str:
    """SHA-256 of the tensors and the header, whatever order they lie in."""
    import torch

    seal = hashlib.sha256()
    for key, text in sorted(header.items()):
        seal.update(f"{key}={text};".encode())
    for name, tensor in sorted(tensors.items()):
        seal.update(f"{name} {tensor.dtype} {list(tensor.shape)};".encode())
        seal.update(tensor.reshape(-1).view(torch.uint8).numpy().data)
    return seal.hexdigest()
