"""What a model file says that it was made with. Its weights, and so torch, are not loaded."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import msgspec

from dore.configure import check_classes, renamed
from dore.schema import Count, checked, named, parse_json
from dore.world.tensor_files import opened

MODEL_FORMAT = "dore-model/1"
MODEL_NAME = "model.safetensors"
"""The model that a run returns."""
SHIPPED = Path(__file__).parents[1] / "weights" / "generalist.safetensors"
"""The model inside the package, for every layout: taught by exact labels; its card lies beside it."""
Q_NETWORK = SHIPPED.with_name("q_network.safetensors")
"""Another one there, for every layout, which learned from rewards alone: its outputs are Q-values."""


class _ModelConfig(msgspec.Struct, forbid_unknown_fields=True):
    """A model's config: the groups that build its networks, and what they learned from."""

    layout: dict[str, Any]
    reach: dict[str, Any]
    instances: dict[str, Any]
    agent: dict[str, Any]
    network: dict[str, Any]
    seed: Count | None = None


def file_of(path: str | os.PathLike[str]) -> Path:
    """A model file, or the one in a run directory."""
    path = Path(path)
    return path / MODEL_NAME if path.is_dir() else path


def config_of(header: Mapping[str, str], parts: Collection[str] | None) -> dict[str, Any]:
    """The config in a model file's header, all of it or these keys alone, whose classes are imported.

    Raises:
        InputError: a damaged one, or one that names what files may not name; does not name the file.
    """
    config = checked(renamed(parse_json(header.get("config", "null"))), _ModelConfig)
    plain = {name: value for name, value in msgspec.structs.asdict(config).items() if value is not None}
    plain = plain if parts is None else {name: plain[name] for name in plain if name in parts}
    check_classes(plain)
    return plain


def read_config(path: str | os.PathLike[str], parts: Collection[str] | None = None) -> dict[str, Any]:
    """The config of a model file, or of the one in a run directory; see `config_of`. Damaged weights go unnoticed.

    Raises:
        InputError: no such file, one that is cut off, or one of another program.
    """
    file = file_of(path)
    with named(file), opened(file, "np", MODEL_FORMAT) as (_, header):
        return config_of(header, parts)
