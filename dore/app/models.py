"""The models that `model=` names: the one in the package, a run, a file, a sweep's folder, or a list of these."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from omegaconf import ListConfig

from dore.app.learning_keys import LATER, LEARNING
from dore.app.run_folder import read_config
from dore.configure import leaves
from dore.errors import InputError, path_of
from dore.files import CONFIG_FILE, DONE_FILE
from dore.learn.model_config import MODEL_NAME, SHIPPED
from dore.learn.model_config import read_config as model_config


@dataclass(frozen=True)
class Model:
    """One model. label: distinguishes it among several; group: the label of all that differ from it by seed only."""

    path: Path | None
    label: str = ""
    group: str = ""

    def config(self, parts: Sequence[str] | None = None) -> dict[str, Any]:
        """What it was made with; these parts of it, or all."""
        return model_config(SHIPPED if self.path is None else self.path, parts)


def models_of(value: object) -> list[Model]:
    """The models that a value of `model` names; a single one has no label.

    Raises:
        InputError: no model, or the same one twice.
    """
    paths = [path for one in (value if isinstance(value, ListConfig | list) else [value]) for path in _paths_of(one)]
    if not paths:
        raise InputError("model: got an empty list, want runs, model files or sweeps")
    if len(paths) == 1:
        return [Model(paths[0])]
    labels = [_label(path) for path in paths]
    if len(set(labels)) < len(labels):
        labels = [
            label if path is None else f"{_folder(path).parent.name}/{label}"
            for path, label in zip(paths, labels, strict=True)
        ]
    if len(set(labels)) < len(labels):
        twice = next(label for label in labels if labels.count(label) > 1)
        raise InputError(f"model: {twice} is given twice, want models of different names")
    return _grouped([Model(path, label) for path, label in zip(paths, labels, strict=True)])


def world_config(models: Sequence[Model], given: Mapping[str, Any], parts: Sequence[str]) -> dict[str, Any]:
    """What the models were made with, where that is the same; that of the package's if there is no other.

    Raises:
        InputError: they differ in one of the `parts` that is not `given`.
    """
    own = [one for one in models if one.path is not None] or list(models)
    first, *others = [one.config(parts) for one in own]
    for part in (one for one in parts if "_target_" not in (given.get(one) or {})):
        for model, config in zip(own[1:], others, strict=True):
            if config[part] != first[part]:
                raise InputError(f"model: {own[0].label} and {model.label} learned on another {part}, want {part}=NAME")
    return first


def _paths_of(value: object) -> list[Path | None]:
    """One model, or those of a folder of runs."""
    if value is None:
        return [None]
    path = path_of("model", value)
    if not path.is_dir() or (path / MODEL_NAME).exists():
        return [path]
    runs = sorted(one.parent for one in path.glob(f"*/{CONFIG_FILE}"))
    with_model = [one for one in runs if (one / MODEL_NAME).exists()]
    for run in runs:
        if not (run / DONE_FILE).exists():
            print(f"{run}: not finished, {'its best so far' if run in with_model else 'left out'}", file=sys.stderr)
    if not with_model:
        raise InputError(f"model: {path} holds no {MODEL_NAME}, and no runs with one")
    return list(with_model)


def _folder(path: Path) -> Path:
    """The name of a model's run: for a file with the name that all models have, its folder."""
    path = path.absolute()
    return path.parent if path.name == MODEL_NAME else path


def _label(path: Path | None) -> str:
    return "shipped" if path is None else _folder(path).name.removesuffix(".safetensors")


def _grouped(models: Sequence[Model]) -> list[Model]:
    """With the name of each one's group: its label without the seed where that is the same for all of them."""
    learned = [_learned(model) for model in models]
    found = []
    for model, mine in zip(models, learned, strict=True):
        labels = [other.label for other, theirs in zip(models, learned, strict=True) if mine == theirs]
        rests = [re.sub(r"(^|[_,/])seed[-=]\d+", "", label).strip("_,") for label in labels]
        common = rests[0] if len(set(rests)) == 1 else f"{labels[0]} and {len(labels) - 1} more"
        found.append(replace(model, group=model.label if len(labels) == 1 else common or "all seeds"))
    return found


def _learned(model: Model) -> str:
    """What a model has learned from, without its seed; the whole config where there is one, else the model file's."""
    config: Mapping[Any, Any] = model.config()
    if model.path is not None and (model.path / CONFIG_FILE).exists():
        config = {key: value for key, value in read_config(model.path).items() if key in (*LEARNING, *LATER)}
    return json.dumps({key: str(value) for key, value in leaves(config) if key != "seed"}, sort_keys=True)
