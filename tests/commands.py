"""Run a command in this process, as a shell would."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import pytest
from hydra.core.global_hydra import GlobalHydra

from dore.app import cli
from dore.planners.straight_line import StraightLine
from dore.world.plan import Plan
from dore.world.problem import Batch

TINY = (
    "layout.rows=3",
    "layout.cols=3",
    "instances.min_obstacles=1",
    "instances.max_obstacles=3",
    "instances.validation_size=20",
    "instances.test_size=20",
    "env.num_envs=16",
    "network.widths=[16]",
    "agent.encoding=planes",
    "buffer.storage.max_size=400",
    "exploration.anneal_steps=300",
    "training.batch_size=8",
    "training.updates=2",
    "training.learning_starts=32",
    "training.max_episodes=150",
    "ipt.n_batches=2",
    "ipt.batch_size=20",
    "ipt.every_episodes=40",
    "ipt.target_success=1.0",
    "log_every=1",
    "logger=none",
)
"""Overrides that make a training run of a second or two."""


def run(command: str, overrides: Sequence[str]) -> int:
    """The exit code of `dore-<command> <overrides>`."""
    GlobalHydra.instance().clear()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", [f"dore-{command}", *overrides])
        with pytest.raises(SystemExit) as ended:
            getattr(cli, command)()
    return int(ended.value.code or 0)


@contextmanager
def ctrl_c_at_plan(number: int) -> Iterator[list[Batch]]:
    """Ctrl-C in the block's `number`th call of the straight-line planner; gives the calls so far."""
    plan, calls = StraightLine.plan, []

    def stopped(self: StraightLine, batch: Batch) -> list[Plan]:
        calls.append(batch)
        if len(calls) == number:
            raise KeyboardInterrupt
        return plan(self, batch)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(StraightLine, "plan", stopped)
        yield calls


def complaints(capsys: pytest.CaptureFixture[str]) -> list[str]:
    """What the command says went wrong; other tests' libraries may have set up loggers that write there too."""
    return [line for line in capsys.readouterr().err.splitlines() if line.startswith("dore-train")]
