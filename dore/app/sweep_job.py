"""One job of a sweep: it trains in a process of its own, into a folder of its own, and records how it ended."""

from __future__ import annotations

import fcntl
import hashlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, Any

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from dore.app import own_parts
from dore.app.learning_keys import check_same
from dore.app.run_folder import finished
from dore.app.sweep import JOBS, STOP, SWEEPING, JobResult, results
from dore.errors import ExitCode, InputError
from dore.files import write_record

POLL_S = 0.2


@dataclass(frozen=True)
class Job:
    """One job of a sweep.

    name: its folder's. root: the sweep's folder. parent: the sweep's process, where this one is its child; else None.
    """

    name: str
    root: Path
    overrides: list[str]
    parent: int | None

    @property
    def folder(self) -> Path:
        """Where it trains."""
        return self.root / self.name

    @property
    def abandoned(self) -> bool:
        """Whether the sweep's process is gone."""
        return self.parent is not None and os.getppid() != self.parent

    def result(self, code: int, message: str, done: Mapping[str, Any] | None = None, before: bool = False) -> JobResult:
        """What is recorded of it; `done` is what a finished run has left."""
        success = None if done is None else done["best_success"]
        return JobResult(str(self.folder), self.overrides, code, message, before, success)


def run_job(cfg: DictConfig) -> float | None:
    """Train one job of a sweep, or resume it, unless it is finished.

    Returns its best IPT success, which a sweeper may maximise; None where it failed or was stopped.
    """
    own_parts.prepare(cfg)
    settings = HydraConfig.get()
    parent = os.getppid() if os.environ.get(SWEEPING) == str(os.getppid()) else None
    job = Job(str(settings.sweep.subdir), Path(settings.sweep.dir), list(settings.overrides.task), parent)
    os.chdir(settings.runtime.cwd)  # A launcher on another machine may have started elsewhere.
    records = job.root / JOBS
    records.mkdir(parents=True, exist_ok=True)
    with (records / f"{job.name.replace('/', '_')}.log").open("ab") as log:
        # A sweeper may ask for the same job twice; and a process that a killed worker left running holds the log, too.
        fcntl.flock(log, fcntl.LOCK_EX)
        result = _run(job, cfg, log)
        print(f"{job.name}: {'finished before, ' if result.before else ''}{result.message}", flush=True)
        digest = hashlib.sha256(" ".join(job.overrides).encode()).hexdigest()
        write_record(records / f"{digest[:16]}.json", asdict(result))
    if job.abandoned:
        os._exit(ExitCode.STOPPED)  # A worker would wait without end for its result to be taken.
    return result.success


def _run(job: Job, cfg: DictConfig, log: IO[bytes]) -> JobResult:
    """Train the job unless there is nothing to train, or it may not."""
    for other in results(job.root):
        if other.folder == str(job.folder) and other.overrides != job.overrides:
            message = f"its folder is that of {' '.join(other.overrides)}, want different names (hydra.sweep.subdir)"
            return job.result(ExitCode.BAD_INPUT, message)
    if done := finished(job.folder, cfg.training):
        try:
            check_same(job.folder, cfg)
        except InputError as error:
            return job.result(ExitCode.BAD_INPUT, str(error))
        return job.result(ExitCode.OK, _summary(done), done, before=True)
    stop = job.root / STOP
    if stop.exists():
        return job.result(ExitCode.STOPPED, "not started")
    print(f"{job.name}: started", flush=True)
    code, message = _train_in_process(job, stop, log)
    with suppress(OSError):
        job.folder.rmdir()  # Hydra made it; a job that could not start has left it empty.
    done = finished(job.folder, cfg.training) if code == ExitCode.OK else None
    return job.result(code, _summary(done) if done else message, done)


def _train_in_process(job: Job, stop: Path, log: IO[bytes]) -> tuple[int, str]:
    """dore-train in a process of its own; its exit code and the last line of its log."""
    quoted = str(job.folder).replace("'", "\\'")
    more = [f"run_dir='{quoted}'", "existing=continue"]
    command = [
        sys.executable,
        "-c",
        "from dore.app.cli import train; train()",
        *job.overrides,
        *own_parts.of_job(),
        *more,
    ]
    began = log.tell()
    # A session of its own: Ctrl-C reaches it through `stop` alone, and so only once.
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT, start_new_session=True
    )
    asked = _wait(process, job, stop)
    code = process.returncode
    if asked and code != 0:
        return ExitCode.STOPPED, "stopped"
    if code < 0:
        name = signal.Signals(-code).name
        return ExitCode.FAILED, f"killed by {name}" + (
            ", as a system does that runs out of memory" if code == -9 else ""
        )
    with open(log.name, "rb") as file:
        file.seek(began)
        lines = [line for line in file.read().decode(errors="replace").splitlines() if line.strip()]
    return code, lines[-1].removeprefix("dore-train: ") if lines else f"exit code {code}"


def _wait(process: subprocess.Popen[bytes], job: Job, stop: Path) -> bool:
    """Wait for a job's process; whether it was asked to stop, by `stop` or because the sweep's process is gone."""
    if job.parent is not None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # A worker's; the sweep's process takes it.
    asked = False
    try:
        while process.poll() is None:
            if not asked and (stop.exists() or job.abandoned):
                process.terminate()
                asked = True
            time.sleep(POLL_S)
    except BaseException:
        process.kill()
        raise
    return asked


def _summary(done: dict[str, Any]) -> str:
    """A finished run in a few words."""
    return (
        f"{done['stop_reason']}, best IPT success {100 * done['best_success']:.1f} %, "
        f"{done['episodes']} episodes in {done['seconds']:.0f} s"
    )
