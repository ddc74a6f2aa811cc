"""What --help and --version say: a command's own config file is its manual, comments and all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import dropwhile, takewhile
from typing import Any

import yaml

from dore import __version__
from dore.files import conf_dir

COMMANDS = ("train", "evaluate", "plan", "execute", "report")
MORE = "--config-dir FOLDER adds options of your own (docs/extending.md); --cfg job prints the composed config."


def answer(command: str, arguments: Sequence[str]) -> str | None:
    """The answer to --help or --version; None where the command line asks for neither."""
    if "--version" in arguments:
        return version()
    return manual(command) if {"--help", "-h"} & set(arguments) else None


def version() -> str:
    """The package's."""
    return f"dore {__version__}"


def overview() -> str:
    """All commands, a line each."""
    lines = [f"  dore {command:<9} {_first_line(command)}" for command in COMMANDS]
    return "\n".join(
        ["dore COMMAND [KEY=VALUE ...], or dore-COMMAND", "", *lines, "", "dore COMMAND --help says more."]
    )


def manual(command: str) -> str:
    """What a command does, its options with the comments of its config file, and its exit codes."""
    lines = _lines(command)
    about = [line.removeprefix("#").removeprefix(" ") for line in takewhile(_is_comment, lines)]
    keys = dropwhile(lambda line: line.startswith((" ", "defaults:")), dropwhile(_is_comment, lines))
    several = ["-m  a sweep: comma-separated values make a job each (docs/sweeps.md)"] if command != "report" else []
    parts = [
        about,
        ["Options, OPTION=NAME:", *_groups(command)],
        ["Keys, KEY=VALUE:", *map(_indented, dropwhile(lambda line: not line, keys))],
    ]
    return "\n\n".join("\n".join(part).rstrip() for part in [*parts, [*several, MORE]])


def _groups(command: str) -> Iterator[str]:
    """A line for each group that a command's defaults name: its options, and which one is taken."""
    for entry in yaml.safe_load("\n".join(_lines(command)))["defaults"]:
        if isinstance(entry, dict) and (group := next(iter(entry))) != "hydra" and not group.startswith("override"):
            taken: Any = entry[group]
            shown = ", ".join(taken) if isinstance(taken, list) else taken or "none given"
            yield f"  {group:<14} {', '.join(_options(group))}  [{shown}]"


def _options(group: str) -> list[str]:
    """The names of a group's options, those in folders of its own with their folder."""
    root = conf_dir() / group
    paths = (path.relative_to(root).with_suffix("") for path in sorted(root.rglob("*.yaml")))
    return [str(path) for path in paths if not path.name.startswith("_")]


def _lines(command: str) -> list[str]:
    return (conf_dir() / f"{command}.yaml").read_text(encoding="utf-8").splitlines()


def _first_line(command: str) -> str:
    return _lines(command)[0].removeprefix(f"# dore-{command}: ")


def _is_comment(line: str) -> bool:
    return line.startswith("#")


def _indented(line: str) -> str:
    return f"  {line}" if line else ""
