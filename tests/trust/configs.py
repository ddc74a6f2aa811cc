"""Every key of every command's config with nonsense: what is refused in one line, what is accepted, what breaks.

    python -m tests.trust.configs out=outputs/trust

Each case runs in a process of its own up to the point where long work would start.
"""

from __future__ import annotations

import contextlib
import io
import os
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any
from unittest import mock

from hydra import compose, initialize_config_dir
from omegaconf import DictConfig, OmegaConf
from tqdm import tqdm

from dore.app import cli
from dore.errors import InputError
from dore.files import conf_dir
from dore.report.measurements import write_measurements
from scripts.program import run

VALUES = ("-1", "0", "1e9", "1000000000", "1e308", "nan", "abc", "null", "[]", "{}")
COMMANDS = {
    "train": ["layout=3x6", "instances.validation_size=50", "instances.test_size=50", "ipt.batch_size=20"],
    "evaluate": ["planner=[learned,straight_line,exact,guided,graph_search,transfer]", "limit=3", "layout=3x6"],
    "plan": ["planner=exact"],
    "execute": ["scene=random", "video=off"],
}
"""The overrides besides: small worlds, and all planners."""
LIMIT_S = 60
STARTS = {
    "train": "dore.learn.trainer.Trainer.run",
    "evaluate": "dore.app.evaluate.evaluate_into",
    "plan": "dore.app.plan.write_plan",
    "execute": "dore.app.execute.run_loop",
}
"""Where each command's long work starts, or where its result leaves it."""


class Started(BaseException):
    """Long work would start here."""


@dataclass
class Case:
    """One key with one value: refused, accepted, traceback, death, hang, or refused in more than a line."""

    command: str
    key: str
    value: str
    outcome: str = ""
    message: str = ""


def keys_of(command: str) -> list[str]:
    """Every key of a command's config, groups among them."""
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        cfg = compose(command, COMMANDS[command])
    return sorted(set(_keys(cfg)))


def _keys(cfg: DictConfig, prefix: str = "") -> Iterator[str]:
    for key in cfg:
        yield prefix + str(key)
        node = OmegaConf.to_container(cfg)[key]  # type: ignore[call-overload,index]
        if isinstance(node, dict):
            yield from _keys(cfg[key], f"{prefix}{key!s}.")


def run_case(case: Case, folder: Path) -> Case:
    """Run a case in a process of its own."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(read)
        with os.fdopen(write, "w") as pipe:
            pipe.write("\n".join(_outcome(case, folder)))
        os._exit(0)
    os.close(write)
    began, status = time.monotonic(), None
    while status is None and time.monotonic() - began < LIMIT_S:
        done, code = os.waitpid(child, os.WNOHANG)
        status = code if done else None
        time.sleep(0.01)
    if status is None:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        case.outcome = "hang"
    with os.fdopen(read) as pipe:
        said = pipe.read()
    if status is not None:
        case.outcome, _, case.message = said.partition("\n") if status == 0 and said else ("death", "", str(status))
    return case


def _outcome(case: Case, folder: Path) -> tuple[str, str]:
    """In the child: what the command does with the case."""
    out = io.StringIO()
    os.chdir(folder)
    sys.argv = [f"dore-{case.command}", *COMMANDS[case.command], f"{case.key}={case.value}"]
    if case.key.endswith("_target_"):
        sys.argv[-1] = f"++{sys.argv[-1]}"
    code: Any = 0
    try:
        with (
            mock.patch(STARTS[case.command], side_effect=Started),
            contextlib.redirect_stderr(out),
            contextlib.redirect_stdout(io.StringIO()),
        ):
            getattr(cli, case.command)()
    except Started:
        return "accepted", ""
    except SystemExit as error:
        code = error.code
    except BaseException:
        return "traceback", "; ".join(traceback.format_exc().splitlines()[-7:])[-400:]
    lines = [line for line in out.getvalue().splitlines() if line.strip()]
    if code == 0:
        return "accepted", ""
    return ("refused" if code == 2 and len(lines) == 1 else f"code {code}, {len(lines)} lines"), "; ".join(lines)[:300]


@dataclass(frozen=True)
class Options:
    """out: the folder of the rows; commands: whose keys; keys: how these begin; every: every nth case only."""

    out: Path
    commands: list[str] = field(default_factory=lambda: list(COMMANDS))
    keys: str = ""
    every: int = 1


def main(options: Options) -> None:
    """Run the cases and write the rows."""
    for command in options.commands:
        if command not in COMMANDS:
            raise InputError(f"commands: got {command!r}, want some of {', '.join(COMMANDS)}")
        import_module(f"dore.app.{command}")
    keys = {command: [key for key in keys_of(command) if key.startswith(options.keys)] for command in options.commands}
    cases = [Case(command, key, value) for command in keys for key in keys[command] for value in VALUES]
    with tempfile.TemporaryDirectory() as folder:
        cases = cases[:: options.every]
        done = [run_case(case, Path(folder)) for case in tqdm(cases, unit="case", mininterval=10.0)]
    write_measurements(options.out / "configs", [asdict(case) for case in done], seed=0)
    for outcome, n in Counter(case.outcome for case in done).most_common():
        print(f"{outcome}: {n}")


if __name__ == "__main__":
    sys.exit(run(main, Options))
