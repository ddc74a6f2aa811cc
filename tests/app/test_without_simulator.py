"""`pip install .`, without the extra `sim`: everything but dore-execute runs, and that names the extra."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from dore.app.cli import SIMULATOR
from tests.commands import TINY

ROOT = Path(__file__).parents[2]
PROGRAM = """
import sys
for name in {blocked!r}:
    sys.modules[name] = None  # importing it raises ModuleNotFoundError
from dore.app import cli
sys.argv = {argv!r}
getattr(cli, {command!r})()
"""
BLOCKED = tuple(name for name in SIMULATOR if name != "PIL")
"""Pillow is there in any case: matplotlib needs it."""


def run_without_simulator(command: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """`dore-<command>` in a process of its own, where no module of the simulator can be imported."""
    program = PROGRAM.format(blocked=BLOCKED, argv=[f"dore-{command}", *arguments], command=command)
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT, check=False)


@pytest.mark.slow
def test_train_evaluate_and_plan(tmp_path):
    commands = (
        ("train", *TINY, f"run_dir={tmp_path / 'run'}"),
        ("evaluate", f"model={tmp_path / 'run'}", f"run_dir={tmp_path / 'evaluation'}", "limit=5"),
        ("plan", "planner=guided", "scene=conf/scenes/fig7.json", f"out={tmp_path / 'plan.json'}"),
    )
    for command in commands:
        done = run_without_simulator(*command)
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "evaluation" / "rows.csv").exists()
    assert (tmp_path / "plan.png").exists()


@pytest.mark.parametrize("arguments", [("plan=conf/plans/fig7.json",), ("scene=random", "loop=closed")])
def test_execute_names_the_extra(arguments, tmp_path):
    done = run_without_simulator("execute", *arguments, f"run_dir={tmp_path / 'execution'}")
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert re.fullmatch(r"dore-execute: needs the simulator, and \w+ is not installed; .*pip install '\.\[sim\]'", line)
    assert not (tmp_path / "execution").exists()


def test_the_simulator_is_an_extra_alone():
    """No package of the simulator is required by `pip install .`, and `.[sim]` has them all."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

    def names(requirements: list[str]) -> set[str]:
        return {re.split(r"[^\w-]", requirement)[0] for requirement in requirements}

    assert names(project["optional-dependencies"]["sim"]) >= {"mani-skill", "sapien", "pin", "imageio"}
    assert not names(project["optional-dependencies"]["sim"]) & names(project["dependencies"])
