"""Files and folders: written whole or not at all, locked, and found; it loads nothing large."""

from __future__ import annotations

import fcntl
import json
import os
import subprocess
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

import msgspec

from dore.errors import InputError
from dore.schema import checked, named, read_json

CONFIG_FILE, ABOUT_FILE, ROWS_FILE = "config.yaml", "about.json", "rows.csv"
"""In a run's folder: its config, what made it, and the rows of an evaluation or a measuring program."""
GROUPS_FILE = "groups.json"
"""In the folder of an evaluation of several models: each planner's name, without what says the seed of its model."""
METRICS_FILE, DONE_FILE, CURVE_FILE = "metrics.csv", "done.json", "learning_curve.png"
"""In a training's: its tests, how it ended, and its tests drawn."""


def conf_dir() -> Path:
    """The configs: inside the installed package, or beside it in a checkout."""
    packed = Path(__file__).parent / "conf"
    return packed if packed.is_dir() else Path(__file__).parents[1] / "conf"


def shipped_or(path: Path, group: str) -> Path:
    """A path as it is given; or, where nothing is there, the file of that name in the package's conf/`group`."""
    packed = conf_dir() / group / f"{path}.json"
    return packed if path.name == str(path) and not path.exists() and packed.is_file() else path


@contextmanager
def atomic_write(path: str | os.PathLike[str], mode: str = "w") -> Iterator[IO[Any]]:
    """Open a temporary file beside `path` and rename it over `path` if the block ends well.

    A crash, a full disk or an exception leaves the old file, or none, and never half a new one. A symbolic link is
    followed.
    """
    path = Path(os.path.realpath(path))
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with open(temporary, mode, encoding=None if "b" in mode else "utf-8") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError as error:
        # A full disk names no file, and a missing folder names the temporary one.
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error
    finally:
        # On a read-only disk even this fails, and would speak of the temporary file.
        with suppress(OSError):
            temporary.unlink()


def check_outputs(**outputs: Path) -> None:
    """Make sure, before any work, that these files can be written; their folders are made.

    Raises:
        InputError: one is a folder, a device or a pipe, or the same file as another; names its key.
        OSError: its folder cannot be made or written to.
    """
    seen: dict[str, str] = {}
    for name, path in outputs.items():
        place = os.path.realpath(path)
        if os.path.lexists(place) and not os.path.isfile(place):
            kind = "a folder" if os.path.isdir(place) else "no regular file"
            raise InputError(f"{name}: {path} is {kind}, want a file")
        if place in seen:
            raise InputError(f"{name}: {path} is the file of {seen[place]} too, want two files")
        seen[place] = name
    for place in seen:
        folder = Path(place).parent
        folder.mkdir(parents=True, exist_ok=True)
        try:
            tempfile.TemporaryFile(dir=folder).close()
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(folder)) from None


@contextmanager
def locked(folder: Path, name: str) -> Iterator[None]:
    """No other process works in the folder meanwhile; a process that is killed leaves no lock.

    Raises:
        InputError: another one does; `name` is the key that gave the folder.
        OSError: no such folder.
    """
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(f"{name}: {folder} is in use by another process") from None
        yield
    finally:
        os.close(handle)


def write_record(path: str | os.PathLike[str], record: Mapping[str, Any]) -> None:
    """Record something of a run in a JSON file."""
    with atomic_write(path) as file:
        json.dump(record, file, indent=2)
        file.write("\n")


def read_record(path: Path) -> dict[str, Any]:
    """What a run has recorded in a JSON file; nothing where there is no such file.

    Raises:
        InputError: a damaged file.
    """
    if not path.exists():
        return {}
    with named(path):
        return checked(read_json(path), dict[str, Any])


class _Done(msgspec.Struct):
    """What every training has recorded at its end; there is more, by version."""

    stop_reason: str
    episodes: int
    seconds: float
    best_success: float | None


def read_done(folder: Path) -> dict[str, Any]:
    """How a training ended: its `stop_reason` and its progress; nothing while it has not ended.

    Raises:
        InputError: a damaged file.
    """
    done = read_record(folder / DONE_FILE)
    if "ending" in done:  # The key's name in version 0.1.
        done["stop_reason"] = done.pop("ending")
    if done:
        with named(folder / DONE_FILE):
            checked(done, _Done)
    return done


def commit() -> str | None:
    """The commit of the checkout that this file is tracked in, if it is in one."""

    def git(*arguments: str) -> str:
        return subprocess.run(
            ["git", *arguments],
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            timeout=5,
            check=True,
        ).stdout.strip()

    try:
        git("ls-files", "--error-unmatch", Path(__file__).name)
        return git("describe", "--always", "--dirty")
    except (OSError, subprocess.SubprocessError):
        return None
