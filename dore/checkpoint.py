"""Checkpoints of a training run (all that it needs to go on) and model files (weights and their config)."""

from __future__ import annotations

import json
import os
import pickle
import zipfile
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from dore.errors import InputError, atomic_write

CHECKPOINT_FORMAT = "dore-checkpoint/1"
MODEL_FORMAT = "dore-model/1"
MODEL_NAME = "model.safetensors"


def save_checkpoint(path: str | os.PathLike[str], parts: dict[str, Any]) -> None:
    """Write the named parts: state dicts, tensors and plain values."""
    with atomic_write(path, "wb") as file:
        torch.save({"format": CHECKPOINT_FORMAT, **parts}, file)


def load_checkpoint(path: str | os.PathLike[str], device: torch.device | str) -> dict[str, Any]:
    """The parts that `save_checkpoint` wrote.

    Raises:
        InputError: no such file, a damaged one, or none of ours.
    """
    try:
        parts = torch.load(path, map_location=device, weights_only=True)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (RuntimeError, EOFError, OSError, pickle.UnpicklingError, zipfile.BadZipFile, KeyError) as error:
        raise InputError(f"{path}: cut off or damaged ({_first_line(error)})") from None
    if not isinstance(parts, dict) or parts.get("format") != CHECKPOINT_FORMAT:
        raise InputError(f"{path}: no checkpoint of this program, want {CHECKPOINT_FORMAT}")
    return parts


def save_model(path: str | os.PathLike[str], weights: dict[str, Tensor], config: dict[str, Any]) -> None:
    """Write a model file: the online networks' weights, and the config that builds them."""
    header = {"format": MODEL_FORMAT, "config": json.dumps(config)}
    data = save({name: tensor.detach().cpu().contiguous() for name, tensor in weights.items()}, header)
    with atomic_write(path, "wb") as file:
        file.write(data)


def load_model(path: str | os.PathLike[str]) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Weights and config of a model file, or of the one in a run directory.

    Raises:
        InputError: no such file, a damaged one, or none of ours.
    """
    path = Path(path)
    if path.is_dir():
        path = path / MODEL_NAME
    try:
        with safe_open(os.fspath(path), framework="pt") as file:
            header = file.metadata() or {}
            weights = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (SafetensorError, OSError) as error:
        raise InputError(f"{path}: cut off or damaged ({_first_line(error)})") from None
    if header.get("format") != MODEL_FORMAT:
        raise InputError(f"{path}: format {header.get('format')!r}, want {MODEL_FORMAT}")
    return weights, json.loads(header["config"])


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__
