"""A run's own folder: config, metrics, checkpoint, model. It is claimed once and never written over silently."""

from __future__ import annotations

import math
import os
import re
import shutil
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import yaml
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from dore.app.jobs import folder_of_job, in_sweep
from dore.configure import check_classes, leaves, renamed
from dore.errors import InputError, pasted, path_of
from dore.files import (
    ABOUT_FILE,
    CONFIG_FILE,
    CURVE_FILE,
    DONE_FILE,
    METRICS_FILE,
    atomic_write,
    commit,
    locked,
    read_done,
    write_record,
)
from dore.schema import named, nearest

CHECKPOINT = "checkpoint.pt"
BUDGET = "budget"
"""The stop reason of a run that a larger budget continues."""
_WRITTEN = (CONFIG_FILE, ABOUT_FILE, METRICS_FILE, DONE_FILE, CURVE_FILE, "tensorboard", "wandb")
"""What a training writes, beside its models and its checkpoint."""
_PACKAGES = ("torch", "torchrl", "tensordict", "numpy", "hydra-core")


@contextmanager
def claimed(path: object, keep_if: tuple[str, ...], resumes: bool = True) -> Iterator[Path]:
    """A new run folder, locked for this process.

    If the block fails before one of the files `keep_if` is there, the folder is removed again, so that a run that could
    not start leaves its name free. Later on the folder stays, and a line says so. resumes: the command has `resume=`.

    Raises:
        InputError: it exists and holds something, or another process has just claimed it.
        OSError: it cannot be made.
    """
    folder = path_of("run_dir", path)
    check_free(folder, resumes)
    folder.mkdir(parents=True, exist_ok=True)
    with locked(folder, "run_dir"):
        check_free(folder, resumes)
        try:
            yield folder
        except BaseException as error:
            if not any((folder / name).exists() for name in keep_if):
                shutil.rmtree(folder, ignore_errors=True)
            elif isinstance(error, Exception):
                print(f"{folder} keeps what was written before the error", file=sys.stderr)
            raise


def check_free(folder: Path, resumes: bool) -> None:
    """Refuse a folder that holds something, and a file.

    Raises:
        InputError: names it, and how to resume a run there where the command `resumes`.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        or_resume = f" (or {pasted('resume', folder)})" if resumes else ""
        raise InputError(f"run_dir: {folder} exists already, want a new one{or_resume}")


def folder_of(cfg: DictConfig, key: str = "run_dir") -> Path:
    """Where a command writes: the path of a key, and in a sweep that path inside the job's own folder.

    Raises:
        InputError: in a sweep, an absolute path, which all jobs would share.
    """
    path = path_of(key, cfg[key])
    if not in_sweep():
        return path
    own = folder_of_job()
    if key == "run_dir":
        return own
    if path.is_absolute() or ".." in path.parts:
        raise InputError(f"{key}: got {path}, want a path inside each job's folder, {own}")
    return own / path


def clear_unstarted(folder: Path) -> None:
    """Remove what a run has left that was killed before its first checkpoint; nothing else is touched.

    Raises:
        InputError: another process works there.
    """

    def of_run(path: Path) -> bool:
        # Killed while it wrote its first file, it has left that file's temporary one.
        begun = (folder / CONFIG_FILE).exists()
        return path.suffix == ".tmp" or (begun and (path.name in _WRITTEN or path.suffix == ".safetensors"))

    if not (folder / CHECKPOINT).exists():
        clear(folder, of_run)


def clear(folder: Path, ours: Callable[[Path], bool]) -> None:
    """Remove a folder, if it is there and all that lies in it is `ours`.

    Raises:
        InputError: another process works there.
    """
    if folder.is_dir():
        with locked(folder, "run_dir"):
            if all(map(ours, list(folder.iterdir()))):
                shutil.rmtree(folder)


def write_config(folder: Path, cfg: DictConfig) -> None:
    """Keep the resolved config, and what made the run."""
    with atomic_write(folder / CONFIG_FILE) as file:
        file.write(OmegaConf.to_yaml(cfg, resolve=True))
    versions = {name: version(name) for name in _PACKAGES}
    about = {"started": time.strftime("%Y-%m-%dT%H:%M:%S%z"), "commit": commit(), "versions": versions}
    write_record(folder / ABOUT_FILE, about)


def load_config(folder: str | os.PathLike[str]) -> DictConfig:
    """The config of a run folder as its file has it; nothing that it names is imported.

    Raises:
        InputError: no run folder, or a damaged config.
    """
    path = Path(folder) / CONFIG_FILE
    try:
        cfg = OmegaConf.load(path)
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"resume: {folder} is no run folder, it has no {CONFIG_FILE}") from None
    except (OmegaConfBaseException, ValueError, yaml.YAMLError) as error:
        raise InputError(f"{path}: damaged ({' '.join(str(error).split())})") from None
    if not isinstance(cfg, DictConfig):
        raise InputError(f"{path}: damaged or cut off, it has no keys")
    return cfg


def read_config(
    folder: str | os.PathLike[str], expected: Iterable[str] = (), known: Iterable[str] | None = None
) -> DictConfig:
    """The config of a run folder, which must have the `expected` keys, and no other ones than the `known`.

    Raises:
        InputError: no run folder, a damaged config, one that names what files may not name, or of another version.
    """
    path, cfg = Path(folder) / CONFIG_FILE, load_config(folder)
    missing = [key for key in expected if key not in cfg]
    if missing:
        raise InputError(f"{path}: damaged or cut off, it lacks {', '.join(missing)}")
    if "updates_per_step" in (cfg.get("training") or {}):
        raise InputError(
            f"{path}: of version 0.1, whose training cannot be resumed; its model still plans and evaluates, "
            "and a new run trains (training.updates and training.update_after instead of training.updates_per_step)"
        )
    options = sorted({*known, *expected} if known is not None else map(str, cfg))
    for key in map(str, cfg):
        if key not in options:
            hint = "; its model still plans and evaluates" if (Path(folder) / CHECKPOINT).exists() else ""
            raise InputError(f"{path}: {key}: no such key{nearest(key, options)}{hint}")
    plain = renamed(OmegaConf.to_container(cfg))
    for key, value in leaves(plain):
        if isinstance(value, str) and "${" in value:
            raise InputError(f"{path}: {key}: got {value!r}, want a value, as the config of a run holds")
    with named(path):
        check_classes(plain)
    return OmegaConf.create(plain)


def changes() -> list[str]:
    """What the command line gives beside `resume` and `trust`."""
    return [change for change in HydraConfig.get().overrides.task if not change.startswith(("resume=", "trust="))]


def changed_keys() -> dict[str, str]:
    """Those changes by the key, or the section, that each of them changes."""
    return {re.split(r"[=.@]", change.lstrip("+~"))[0]: change for change in changes()}


def mark_done(folder: Path, result: Mapping[str, Any]) -> None:
    """Write the file that says a run has ended, and how; what is not finite is null."""
    finite = {name: None if isinstance(one, float) and not math.isfinite(one) else one for name, one in result.items()}
    write_record(folder / DONE_FILE, finite)


def finished(folder: Path, training: Mapping[str, Any]) -> dict[str, Any] | None:
    """What `mark_done` wrote, unless that run has ended by its budget and `training` gives it a larger one."""
    done = read_done(folder)
    if not done:
        return None
    minutes, updates = training["max_minutes"], training["max_updates"]
    spent = (
        done["episodes"] >= training["max_episodes"]
        or (minutes is not None and done["seconds"] >= 60 * minutes)
        or (updates is not None and done["updates"] >= updates)
    )
    return done if spent or done["stop_reason"] != BUDGET else None
