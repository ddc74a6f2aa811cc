"""Files and folders: written whole or not at all, locked, and found; it loads nothing large."""

from __future__ import annotations

import fcntl
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from dore.errors import InputError


def conf_dir() -> Path:
    """The configs: inside the installed package, or beside it in a checkout."""
    packed = Path(__file__).parent / "conf"
    return packed if packed.is_dir() else Path(__file__).parents[1] / "conf"


@contextmanager
def atomic_write(path: str | os.PathLike[str], mode: str = "w") -> Iterator[IO[Any]]:
    """Open a temporary file beside `path` and rename it over `path` if the block ends well.

    A crash, a full disk or an exception leaves the old file, or none, and never half a new one.
    """
    path = Path(path)
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
