"""docs/extending.md and uses.md from an empty folder: their files are written, their commands run on small budgets."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from dore.configure import _users
from dore.sim.scene.agent import render_backend
from tests.app.uses import installed, write_files
from tests.commands import run

ROOT = Path(__file__).parents[2]
PAGES = [(ROOT / "docs" / name).read_text(encoding="utf-8") for name in ("extending.md", "uses.md")]
SECTIONS = {part.partition("\n")[0]: part for page in PAGES for part in re.split(r"^## ", page, flags=re.M)[1:]}
FEW = ("instances.validation_size=60", "instances.test_size=60")
SMALL = {
    "train": (*FEW, "training.max_episodes=200", "ipt.batch_size=30", "env.num_envs=32", "logger=none"),
    "evaluate": ("limit=5",),
    "plan": (),
    "execute": ("video=off",),
}
"""What is added to a command so that it takes seconds."""


def commands(section: str) -> list[tuple[str, list[str]]]:
    lines = [line for block in re.findall(r"```sh\n(.*?)```", section, flags=re.S) for line in block.splitlines()]
    found = []
    for program, *given in map(shlex.split, lines):
        small = () if "instances=file" in given else SMALL[program.removeprefix("dore-")]
        if any(one.startswith("arm=") for one in given):
            small = ("limit=2",)
        found.append((program.removeprefix("dore-"), [*given, *small]))
    return found


def wanted(command: str, arguments: list[str]) -> tuple[int, ...]:
    """A model of a second may find no plan; and there is no camera without Vulkan."""
    if "loop=closed" in arguments and render_backend() == "none":
        return (2,)
    return (0, 4) if command == "plan" else (0,)


@pytest.mark.sim
@pytest.mark.parametrize("name", SECTIONS)
def test_a_section_runs_as_it_is_written(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    write_files(tmp_path, SECTIONS[name])
    for command, arguments in commands(SECTIONS[name]):
        if "-m" in arguments:
            if name.startswith("A network"):
                pytest.skip("its second command compares what its sweep trains: the slow test runs both")
            continue  # Each job is a process, or loads a simulator, and takes seconds; the slow test starts them.
        _users.clear()  # Each command is a process of its own.
        assert run(command, arguments) in wanted(command, arguments), arguments


@pytest.mark.slow
@pytest.mark.sim
def test_every_section_runs_against_the_wheel(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(installed(tmp_path)))
    (tmp_path / "mine").mkdir()
    # As a console script starts: the current folder is not on its path.
    start = "import sys; sys.path.remove(''); from dore.app.cli import {0}; {0}()"
    where = f"{start}; import dore; assert dore.__file__.startswith({str(tmp_path)!r})"
    for section in SECTIONS.values():
        write_files(tmp_path / "mine", section)
        for command, arguments in commands(section):
            code = subprocess.run(
                [sys.executable, "-c", where.format(command), *arguments], cwd=tmp_path / "mine"
            ).returncode
            assert code in wanted(command, arguments), arguments
