"""A sweep's jobs (dore-train -m): each trains in a process of its own, and records in a file how it ended.

So a job that is killed takes no other with it, jobs do not write into each other's progress, and every launcher's
workers report in the same way, on this machine or on another that shares the folder.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import ValueType
from hydra.experimental.callback import Callback
from omegaconf import DictConfig

from dore.errors import ExitCode, InputError, path_of
from dore.files import locked

JOBS, STOP = "jobs", "stop"
"""In a sweep's folder: each job's log and result, and the file that asks all jobs to stop."""
SWEEPING = "DORE_SWEEP_PID"
"""The environment variable by which a launcher's worker knows the process that it works for."""


@dataclass(frozen=True)
class JobResult:
    """How a job of a sweep ended.

    code: its exit code. message: how it went, or why it broke. before: it was finished already.
    success: its best IPT success; None where it is not finished.
    """

    folder: str
    overrides: list[str]
    code: int
    message: str
    before: bool
    success: float | None


def results(root: Path) -> list[JobResult]:
    """Those of a sweep's jobs that have ended since it was started."""
    found = (JobResult(**json.loads(path.read_text(encoding="utf-8"))) for path in (root / JOBS).glob("*.json"))
    return sorted(found, key=lambda one: one.folder)


class Sweep:
    """What the process that started a sweep holds until its end: the folder's lock, and how it takes Ctrl-C."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / JOBS).mkdir(parents=True, exist_ok=True)
        self.held = ExitStack()
        self.held.enter_context(locked(folder, "sweep"))
        (folder / STOP).unlink(missing_ok=True)
        for old in (folder / JOBS).glob("*.json"):
            old.unlink()
        os.environ[SWEEPING] = str(os.getpid())
        self.held.callback(os.environ.pop, SWEEPING)
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self.held.callback(signal.signal, number, signal.signal(number, self._ask_to_stop))

    def _ask_to_stop(self, number: int, frame: FrameType | None) -> None:
        """Every job leaves a checkpoint and ends; a second Ctrl-C ends them at once."""
        (self.folder / STOP).touch()
        print("stopping: each job leaves a checkpoint", file=sys.stderr, flush=True)
        signal.signal(number, signal.default_int_handler)

    def conclude(self) -> int:
        """Say how the jobs ended, the broken ones by name; the exit code of the worst."""
        with self.held:
            ended = results(self.folder)
            asked = (self.folder / STOP).exists()
        done, stopped = ([one for one in ended if one.code == code] for code in (ExitCode.OK, ExitCode.STOPPED))
        broken = [one for one in ended if one not in (*done, *stopped)]
        before = sum(one.before for one in done)
        print(f"sweep {self.folder}: {len(done)} jobs done ({before} of them before), {len(broken)} broken", flush=True)
        for one in broken:
            print(f"dore-train: broken: {one.folder} ({' '.join(one.overrides)}): {one.message}", file=sys.stderr)
        if broken:
            print(f"the jobs' logs are in {self.folder / JOBS}")
        if stopped or asked:
            print(f"stopped: {len(stopped)} jobs wait, and more may; the same command, with this folder, resumes them")
            return ExitCode.STOPPED
        return max((one.code for one in ended), default=0)


_started: Sweep | None = None


class Start(Callback):  # type: ignore[misc]
    """Hydra calls it in the process that starts a sweep, before any job."""

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Claim the sweep's folder.

        Raises:
            SystemExit: two jobs, or two sweeps, would share a folder. Hydra would swallow an Exception.
        """
        global _started
        try:
            path_of("sweep", config.sweep)
            _check_jobs_differ(config)
            _started = Sweep(path_of("hydra.sweep.dir", config.hydra.sweep.dir))
        except (InputError, OSError) as error:
            print(f"dore-train: {error}", file=sys.stderr)
            raise SystemExit(ExitCode.BAD_INPUT) from None
        print(f"sweep in {_started.folder}", flush=True)


def conclude() -> int | None:
    """The exit code of the sweep that this process has started, once it is reported; None if it has started none."""
    global _started
    sweep, _started = _started, None
    return None if sweep is None else sweep.conclude()


def _check_jobs_differ(config: DictConfig) -> None:
    """A job's folder is named after its overrides, so no two jobs may have the same.

    Raises:
        InputError: a value that is given twice, or several values of a key that is in no job's name.
    """
    given = [f"{key}={value}" for key, value in (config.hydra.sweeper.get("params") or {}).items()]
    unnamed = set(config.hydra.job.config.override_dirname.exclude_keys)
    for override in OverridesParser.create().parse_overrides([*given, *config.hydra.overrides.task]):
        if not override.is_discrete_sweep() or override.value_type is ValueType.GLOB_CHOICE_SWEEP:
            continue
        key, values = override.get_key_element(), list(override.sweep_string_iterator())
        for value in values:
            if values.count(value) > 1:
                raise InputError(f"{key}: {value} is given twice, but no two jobs may share a folder")
        if key in unnamed and len(values) > 1:
            raise InputError(f"{key}: got {', '.join(values)}, want one: no job's folder is named after it")
