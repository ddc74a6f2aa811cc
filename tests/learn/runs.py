"""What the tests of training runs share: the paper's preset made tiny, and what two runs have in common."""

from __future__ import annotations

import csv
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import hydra
import pytest
import torch
from hydra.core.global_hydra import GlobalHydra

from dore.app import session
from dore.app.training import trainer_of
from dore.files import conf_dir
from dore.learn.checkpoint import load_checkpoint
from dore.learn.trainer import Trainer
from tests.commands import TINY, run

TIMES = ("seconds", "env_steps_per_s", "planning_s")


def rows_of(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV file, without what a clock gave."""
    with path.open(encoding="utf-8") as file:
        return [{k: v for k, v in row.items() if k not in TIMES} for row in csv.DictReader(file)]


def metrics(folder: Path) -> list[dict[str, str]]:
    """Those of a training."""
    return rows_of(folder / "metrics.csv")


def same(a: object, b: object) -> bool:
    """Whether two checkpoints' parts are equal, bit for bit."""
    if isinstance(a, torch.Tensor):
        return torch.equal(a, b)
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a if key not in TIMES)
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    return a == b or (a != a and b != b)


@contextmanager
def ctrl_c_at(iteration: int) -> Iterator[None]:
    """Trainings in the block are stopped after an iteration."""
    report = session.Session._report

    def interrupted(self, progress, tested):
        report(self, progress, tested)
        if progress.iteration == iteration:
            self._ask_to_stop(signal.SIGINT, None)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(session.Session, "_report", interrupted)
        yield


def stopped_and_resumed(folder: Path, common: list[str], iteration: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """The last checkpoints of a run in folder/whole, and of one in folder/parts that Ctrl-C stopped once."""
    assert run("train", [*common, f"run_dir={folder / 'whole'}"]) == 0
    with ctrl_c_at(iteration):
        assert run("train", [*common, f"run_dir={folder / 'parts'}"]) == 130
    assert run("train", [f"resume={folder / 'parts'}"]) == 0
    whole, parts = (load_checkpoint(folder / name / "checkpoint.pt") for name in ("whole", "parts"))
    return whole, parts


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
