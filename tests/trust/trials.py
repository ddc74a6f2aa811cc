"""Commands that are started, killed and judged, and disks that are too small, for `tests.trust.kills`."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from dore.errors import InputError


@dataclass
class Trial:
    """One trial, and what became of it."""

    command: str
    kind: str
    times: int = 1
    lost: int = 0
    wrong: int = 0
    message: str = ""


def start(command: str, *overrides: str, cwd: Path) -> subprocess.Popen[bytes]:
    """A command in a session of its own."""
    code = f"from dore.app.cli import {command}; {command}()"
    path = str(Path(__file__).parents[2])
    return subprocess.Popen(
        [sys.executable, "-c", code, *overrides],
        cwd=cwd,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"},
    )


def finish(process: subprocess.Popen[bytes]) -> tuple[int, str]:
    """Exit code and what was said on stderr."""
    _, said = process.communicate(timeout=300)
    text = said.decode(errors="replace")
    return process.returncode, "\n".join(line for line in text.splitlines() if re.match(r"dore-|Traceback", line))


def kill(process: subprocess.Popen[bytes], after_s: float) -> bool:
    """Kill a command and its children after some seconds; whether it was still at work."""
    try:
        process.communicate(timeout=after_s)
        return False
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return True


def checked(trial: Trial, judge: Callable[[], Sequence[str]]) -> Trial:
    """Add what a judge finds wrong; a file that cannot be read is lost."""
    try:
        faults = list(judge())
        trial.wrong += len(faults)
    except (InputError, OSError) as error:
        trial.lost += 1
        faults = [str(error)]
    trial.message = "; ".join([trial.message, *faults]).strip("; ")
    return trial


def time_of(command: str, *overrides: str, cwd: Path) -> float:
    """The seconds that a command takes when nothing happens to it, on this machine, now."""
    began = time.perf_counter()
    finish(start(command, *overrides, cwd=cwd))
    return time.perf_counter() - began


def wait_for(path: Path, process: subprocess.Popen[bytes]) -> None:
    """Until a file is there, or the process has ended."""
    while not path.exists() and process.poll() is None:
        time.sleep(0.05)


@contextmanager
def small_disk(folder: Path, kilobytes: int) -> Iterator[Path]:
    """A disk in memory."""
    folder.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "tmpfs", str(folder)], check=True)
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)
