"""Checkpoints of a training run (all that it needs to resume) and model files (weights and their config).

Not `torchrl.checkpoint.Checkpoint` (0.14): it moves the old checkpoint aside before it renames the new one, so that a
kill in between leaves none under the name, and it writes no fsync; its folders also keep a replay's empty places.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
from collections.abc import Collection
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import Tensor

from dore.errors import InputError
from dore.files import atomic_write
from dore.learn.model_config import MODEL_FORMAT, MODEL_NAME, Q_NETWORK, SHIPPED, config_of, file_of
from dore.schema import checked, named, parse_json
from dore.world.tensor_files import read_tensors, write_tensors

__all__ = ["BEST_NAME", "MODEL_NAME", "Q_NETWORK", "SHIPPED", "Tested", "ipt_of", "load_checkpoint", "load_model"]
__all__ += ["save_checkpoint", "save_model"]

CHECKPOINT_FORMAT = "dore-checkpoint/1"
SEALED = b"dore-checkpoint/2 "
"""How a checkpoint begins; the SHA-256 of the rest follows. Older ones begin as torch's own files do."""
BEST_NAME = "best.safetensors"
"""The model of the best IPT, beside `MODEL_NAME`, where a run returns the last one (`training.keep=last`)."""


def save_checkpoint(path: str | os.PathLike[str], parts: dict[str, Any]) -> None:
    """Write the named parts: state dicts, tensors and plain values."""
    # Through memory: on a full disk torch would mask the OSError.
    data = io.BytesIO()
    torch.save({"format": CHECKPOINT_FORMAT, **parts}, data)
    with atomic_write(path, "wb") as file:
        file.write(SEALED + hashlib.sha256(data.getbuffer()).hexdigest().encode() + b"\n")
        file.write(data.getbuffer())


def load_checkpoint(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The parts that `save_checkpoint` wrote, on the CPU.

    Raises:
        InputError: no such file, a damaged one, or one of another program.
    """
    with named(path):
        try:
            parts = torch.load(_unsealed(Path(path)), map_location="cpu", weights_only=True)
        except FileNotFoundError:
            raise InputError("no such file") from None
        except InputError:
            raise
        except Exception as error:  # A mutated pickle raises all kinds of errors in torch's unpickler.
            why = next(iter(str(error).splitlines()), type(error).__name__)
            raise InputError(f"cut off or damaged ({why})") from None
        if not isinstance(parts, dict) or parts.get("format") != CHECKPOINT_FORMAT:
            raise InputError(f"no checkpoint of this program, want {CHECKPOINT_FORMAT}")
    return parts


def _unsealed(path: Path) -> io.BytesIO:
    """The part of a checkpoint that is torch's, if its digest is right."""
    data = path.read_bytes()
    if not data.startswith(SEALED):
        return io.BytesIO(data)
    head, _, rest = data.partition(b"\n")
    if head != SEALED + hashlib.sha256(rest).hexdigest().encode():
        raise InputError("cut off or damaged (its digest is not that of its content)")
    return io.BytesIO(rest)


class Tested(NamedTuple):
    """The IPT that a model was kept for."""

    success: float
    cost: float


def save_model(
    path: str | os.PathLike[str], weights: dict[str, Tensor], config: dict[str, Any], tested: Tested | None = None
) -> None:
    """Write a model file: the online networks' weights, the config that builds them, and the test that it passed."""
    header = {"format": MODEL_FORMAT, "config": json.dumps(config)}
    write_tensors(path, weights, header if tested is None else {**header, "tested": json.dumps(tested)})


def ipt_of(path: Path) -> Tested | None:
    """The IPT that a model was kept for; None: no model, or one that does not say.

    Raises:
        InputError: a damaged file.
    """
    if not path.exists():
        return None
    with named(path):
        _, header = read_tensors(path, MODEL_FORMAT)
        return Tested(*checked(parse_json(header["tested"]), tuple[float, float])) if "tested" in header else None


def load_model(
    path: str | os.PathLike[str], parts: Collection[str] | None = None
) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Weights and config of a model file, or of the one in a run directory; of the config all, or these keys alone,
    whose classes are imported.

    Raises:
        InputError: no such file, a damaged one, one of another program, or one that names what files may not name.
    """
    file = file_of(path)
    with named(file):
        weights, header = read_tensors(file, MODEL_FORMAT)
        return weights, config_of(header, parts)
