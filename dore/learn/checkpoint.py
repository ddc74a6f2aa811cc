"""Checkpoints of a training run (all that it needs to resume) and model files (weights and their config).

Not `torchrl.checkpoint.Checkpoint` (0.14): it moves the old checkpoint aside before it renames the new one, so that a
kill in between leaves none under the name, and it writes no fsync; its folders also keep a replay's empty places.
"""

from __future__ import annotations

import io
import json
import os
import pickle
import zipfile
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from dore.configure import renamed
from dore.errors import InputError
from dore.files import atomic_write
from dore.world.files import read_tensors, write_tensors

CHECKPOINT_FORMAT = "dore-checkpoint/1"
MODEL_FORMAT = "dore-model/1"
MODEL_NAME = "model.safetensors"
"""The model that a run returns."""
BEST_NAME = "best.safetensors"
"""The model of the best IPT, beside it, where a run returns the last one (`training.keep=last`)."""
SHIPPED = Path(__file__).parents[1] / "weights" / "generalist.safetensors"
"""The model inside the package, for every layout; its card lies beside it."""


def save_checkpoint(path: str | os.PathLike[str], parts: dict[str, Any]) -> None:
    """Write the named parts: state dicts, tensors and plain values."""
    # Through memory: on a full disk torch would mask the OSError.
    data = io.BytesIO()
    torch.save({"format": CHECKPOINT_FORMAT, **parts}, data)
    with atomic_write(path, "wb") as file:
        file.write(data.getbuffer())


def load_checkpoint(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The parts that `save_checkpoint` wrote, on the CPU.

    Raises:
        InputError: no such file, a damaged one, or one of another program.
    """
    try:
        parts = torch.load(path, map_location="cpu", weights_only=True)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (RuntimeError, EOFError, OSError, pickle.UnpicklingError, zipfile.BadZipFile, KeyError) as error:
        raise InputError(f"{path}: cut off or damaged ({_first_line(error)})") from None
    if not isinstance(parts, dict) or parts.get("format") != CHECKPOINT_FORMAT:
        raise InputError(f"{path}: no checkpoint of this program, want {CHECKPOINT_FORMAT}")
    return parts


def save_model(path: str | os.PathLike[str], weights: dict[str, Tensor], config: dict[str, Any]) -> None:
    """Write a model file: the online networks' weights, and the config that builds them."""
    write_tensors(path, weights, {"format": MODEL_FORMAT, "config": json.dumps(config)})


def load_model(path: str | os.PathLike[str]) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Weights and config of a model file, or of the one in a run directory.

    Raises:
        InputError: no such file, a damaged one, or one of another program.
    """
    path = Path(path)
    file = path / MODEL_NAME if path.is_dir() else path
    weights, header = read_tensors(file, MODEL_FORMAT)
    try:
        config = json.loads(header["config"])
    except (KeyError, json.JSONDecodeError):
        config = None
    if not isinstance(config, dict):
        raise InputError(f"{file}: cut off or damaged (its config cannot be read)")
    return weights, renamed(config)


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__
