"""What the tests of training runs share: the paper's preset made tiny, and what two runs have in common."""

from __future__ import annotations

import csv

import hydra
import torch
from hydra.core.global_hydra import GlobalHydra

from dore.app.training import trainer_of
from dore.files import conf_dir
from dore.learn.trainer import Trainer
from tests.commands import TINY

TIMES = ("seconds", "env_steps_per_s")


def metrics(folder) -> list[dict[str, str]]:
    """The rows of metrics.csv, without what a clock gave."""
    with open(folder / "metrics.csv", encoding="utf-8") as file:
        return [{k: v for k, v in row.items() if k not in TIMES} for row in csv.DictReader(file)]


def same(a: object, b: object) -> bool:
    """Whether two checkpoints' parts are equal, bit for bit."""
    if isinstance(a, torch.Tensor):
        return torch.equal(a, b)
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a if key not in TIMES)
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    return a == b or (a != a and b != b)


LITERAL = [
    *(option for option in TINY if not option.startswith(("agent.", "training.", "layout."))),
    *("layout.rows=3", "layout.cols=4", "instances.train_size=40", "training.fill=50", "training.batch_size=4"),
    *("training.max_episodes=60", "target_update.value_network_update_interval=9"),
]
"""A tiny run of the paper's preset; its targets are copied every 10 updates."""


def literal(paper: str, *overrides: str) -> Trainer:
    GlobalHydra.instance().clear()
    soft = "target_update=soft" in overrides
    options = [option for option in LITERAL if not (soft and option.startswith("target_update."))]
    with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
        return trainer_of(hydra.compose("train", [f"experiment=paper/{paper}", *options, *overrides]))


def key_of(name: str) -> str:
    """Where a checkpoint's loss keeps a weight of the networks."""
    head, *rest = name.split(".")
    return f"{head}_params." + ".".join(["module", *rest])
