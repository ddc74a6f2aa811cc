"""A sweep's jobs (dore-train -m): each trains in a process of its own, and records in a file how it ended.

So a killed job does not affect the others, jobs do not write into each other's progress, and every launcher's
workers report in the same way, on this machine or on another that shares the folder.
"""

from __future__ import annotations

import json
import os
import shlex
import signal
import sys
import threading
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from omegaconf import DictConfig

from dore.app import jobs
from dore.errors import ExitCode, pasted, path_of
from dore.files import locked

JOBS, STOP = "jobs", "stop"
"""In a sweep's folder: each job's log and result, and the file that asks all jobs to stop."""
SWEEPING = "DORE_SWEEP_PID"
"""The environment variable by which a launcher's worker knows the process that it works for."""


@dataclass(frozen=True)
class JobResult:
    """How a job of a sweep ended.

    code: its exit code. message: its result, or why it failed. before: it was finished already.
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
        """Report how the jobs ended, failed ones by name, and the results of the others; the worst exit code."""
        from dore.app.summary import summarise  # With pandas, which no job needs.

        with self.held:
            ended = results(self.folder)
            asked = (self.folder / STOP).exists()
        done, stopped = ([one for one in ended if one.code == code] for code in (ExitCode.OK, ExitCode.STOPPED))
        broken = [one for one in ended if one not in (*done, *stopped)]
        before = sum(one.before for one in done)
        print(f"sweep {self.folder}: {len(done)} jobs done ({before} of them before), {len(broken)} broken", flush=True)
        for one in broken:
            print(f"dore-train: broken: {one.folder} ({shlex.join(one.overrides)}): {one.message}", file=sys.stderr)
        if done:
            print(summarise(self.folder, ended), flush=True)
        if broken:
            print(f"the jobs' logs are in {self.folder / JOBS}")
        if stopped or asked:
            again = f"the same command with {pasted('hydra.sweep.dir', self.folder)} resumes them"
            print(f"stopped: {len(stopped)} jobs wait, and more may; {again}")
            return ExitCode.STOPPED
        return max((one.code for one in ended), default=0)


_started: Sweep | None = None


class Start(jobs.Start):
    """Of trainings, whose jobs share what they hold until the end."""

    def begin(self, config: DictConfig) -> None:
        """Claim the sweep's folder.

        Raises:
            InputError: two jobs, or two sweeps, would share a folder.
            OSError: it cannot be made.
        """
        global _started
        super().begin(config)
        _started = Sweep(path_of("hydra.sweep.dir", config.hydra.sweep.dir))
        print(f"sweep in {_started.folder}", flush=True)


def conclude() -> int | None:
    """The exit code of the sweep that this process has started, once it is reported; None if it has started none."""
    global _started
    sweep, _started = _started, None
    return None if sweep is None else sweep.conclude()
