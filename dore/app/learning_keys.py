"""The keys of a config that say what a run learns, and whether two runs learn the same."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

from omegaconf import DictConfig, OmegaConf

from dore.app.run_folder import read_config
from dore.configure import leaves, renamed
from dore.errors import InputError

LEARNING = (
    *("layout", "reach", "instances", "agent", "network", "seed"),
    *("training", "ipt", "buffer", "env", "exploration", "optimizer", "target_update"),
)
"""The keys of a run's config that say what it learns, and that every run has."""
LATER = ("worlds", "teacher", "init")
"""More of them, which runs of earlier versions do not have."""
PARTS = ("buffer", "network")
"""Those below which a key that a run does not have means another part, as a sampler."""
FIRST = {"agent.n_steps": 1}
"""What runs that do not have a key learned by."""
BUDGET_KEYS = tuple(f"training.{key}" for key in ("min_episodes", "max_episodes", "max_minutes", "max_updates"))
"""Those of its budget, which alone may change when it is resumed."""


def learning_keys(cfg: DictConfig) -> dict[str, Any]:
    """Every dotted key that says what a run learns and how, but for its budget; a checkpoint holds them too."""
    plain = OmegaConf.to_container(OmegaConf.create(OmegaConf.to_yaml(cfg, resolve=True)))  # As a file holds them.
    learns = {name: node for name, node in cast(dict[str, Any], plain).items() if name in (*LEARNING, *LATER)}
    return {key: value for key, value in leaves(renamed(learns)) if key not in BUDGET_KEYS}


def check_same(folder: Path, cfg: DictConfig) -> None:
    """The run in a folder learns as `cfg` says, but for its budget.

    Raises:
        InputError: it does not, or is damaged; names the first key that differs.
    """
    check_learns(f"run_dir: {folder}", learning_keys(read_config(folder, LEARNING)), learning_keys(cfg))


def check_learns(who: str, was: Mapping[str, Any], now: Mapping[str, Any]) -> None:
    """Two sets of `learning_keys` agree; keys that `was` does not know are newer than it.

    Args:
        who: what was started as `was` says.

    Raises:
        InputError: they do not; names the first key that differs.
    """
    added = [key for key in now if key not in was and (key.split(".")[0] in (*LATER, *PARTS) or key in FIRST)]
    for key in (*was, *added):
        before = was.get(key, FIRST.get(key))
        if now.get(key) != before:
            raise InputError(f"{who} was started with {key}={before}, not {now.get(key)}")
