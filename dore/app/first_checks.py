"""What a command can refuse before torch is loaded, which takes seconds."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

from omegaconf import DictConfig, ListConfig, OmegaConf

from dore.app import run_folder
from dore.app.jobs import in_sweep
from dore.app.learning_keys import BUDGET_KEYS
from dore.configure import leaves
from dore.errors import InputError, path_of, shown
from dore.files import conf_dir, shipped_or
from dore.schema import nearest

MAY_CHANGE = {"train": BUDGET_KEYS, "evaluate": ()}
"""The keys that the command line may give beside `resume`."""
KEPT_AS = {"planner": "planners", "arm": "arm.model._target_"}
"""Options whose choice a run's config keeps under another key."""


def check(command: str, cfg: DictConfig) -> None:
    """Refuse files that are not there, folders that are taken, and what a run cannot be resumed with.

    Raises:
        InputError: names the key.
    """
    _check_files(cfg)
    if command == "execute" and (cfg.plan is None) == (cfg.scene is None):
        raise InputError("plan, scene: want one of them: a plan file, or a scene file or random")
    if command == "train":
        OmegaConf.to_container(cfg, resolve=True)  # A value that is taken from a key which is not there.
        if cfg.existing not in ("refuse", "continue"):
            raise InputError(f"existing: got {cfg.existing!r}, want refuse or continue")
    if in_sweep():
        return
    if cfg.get("resume") is not None:
        _check_resume(path_of("resume", cfg.resume), MAY_CHANGE[command])
    elif "run_dir" in cfg and cfg.get("existing") != "continue":
        run_folder.check_free(path_of("run_dir", cfg.run_dir), resumes="resume" in cfg)


def _check_files(cfg: DictConfig) -> None:
    for key, group in (("scene", "scenes"), ("plan", "plans"), ("model", "")):
        value = cfg.get(key)
        if value is None or value == "random" or isinstance(value, ListConfig):
            continue
        if not shipped_or(path_of(key, value), group).exists():
            packed = [path.stem for path in (conf_dir() / group).glob("*.json")] if group else []
            raise InputError(f"{value}: no such file{nearest(str(value), packed)}")


def _check_resume(folder: Path, may_change: Sequence[str]) -> None:
    kept = run_folder.load_config(folder)
    for change in run_folder.changes():
        key = change.split("=")[0].lstrip("+~")
        if key not in may_change:
            only = f"; only {', '.join(may_change)} can" if may_change else ""
            raise InputError(f"resume: {change} cannot be changed in {folder}{_where_it_is(kept, key)}{only}")


def _where_it_is(kept: DictConfig, key: str) -> str:
    """What a run's config has for a key or an option, in words; nothing where it has no such key."""
    node = OmegaConf.select(kept, KEPT_AS.get(key, key), default=key)
    if isinstance(node, DictConfig):
        plain = cast(dict[str, Any], OmegaConf.to_container(node))
        named = [f"{name}={value}" for name, value in leaves(plain) if "_target_" not in name]
        return f", where it has {', '.join(map(str, plain) if key == 'planner' else named)}"
    return "" if node == key else f", where it is {shown(node)}"
