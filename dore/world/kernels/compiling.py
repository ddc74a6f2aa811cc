"""How a kernel is compiled, where compiled code is kept, and the clock that kernels read.

The kernels are plain functions: with NUMBA_DISABLE_JIT=1 all of this package runs as Python, under a debugger say.
"""

from __future__ import annotations

import hashlib
import os
import stat
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from numba import config, njit, types
from numba.core import event

Function = TypeVar("Function", bound=Callable[..., Any])


def _cache_folder() -> str | None:
    """A folder for these kernels' compiled code that this user alone can write; None where there is none.

    numba looks for changes in the file of the function it compiled, and not in those of the functions called from
    there. So the folder is named after all files of this package: a changed kernel never runs from an old cache.
    """
    name = f"dore-{os.getuid()}-{digest_of(Path(__file__).parent)}"
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    for base in (config.CACHE_DIR, home, tempfile.gettempdir()):
        if os.path.isabs(base) and _is_private(folder := Path(base) / name):
            return str(folder)
    return None


def digest_of(package: Path) -> str:
    """Of all modules in a folder."""
    files = sorted(package.glob("*.py"))
    return hashlib.sha256(b"\0".join(file.read_bytes() for file in files)).hexdigest()[:16]


def _is_private(folder: Path) -> bool:
    """Whether a folder can be written, and by no other user: what lies in it is run."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            found = folder.lstat()
    except OSError:
        return False
    others_write = found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not others_write


CACHE_FOLDER = None if config.DISABLE_JIT else _cache_folder()


class _Notice(event.Listener):  # type: ignore[misc]
    """Says once, on a terminal, why nothing seems to happen."""

    announced = False

    def on_start(self, event: event.Event) -> None:
        """A kernel is compiled, and not loaded from the disk."""
        if not self.announced and sys.stderr.isatty():
            print("compiling the search, once after an installation: up to a minute", file=sys.stderr, flush=True)
        self.announced = True

    def on_end(self, event: event.Event) -> None:
        """Nothing to say."""


NOTICE = _Notice()
event.register("numba:compile", NOTICE)


def kernel(function: Function) -> Function:
    """Compile a function that only other kernels call.

    Compiled code is told apart by module, name and types: a kernel that is made inside another function, twice, would
    be mistaken for its namesake once one of them comes from the cache.
    """
    # Without the counting of references to arrays, which would be most of the work; so no kernel may allocate.
    compiled: Function = njit(_nrt=False)(function)
    return compiled


def entry(function: Function) -> Function:
    """Compile a function that Python calls: without the GIL, and kept on disk for the next process."""
    if CACHE_FOLDER is None:
        compiled: Function = njit(nogil=True, _nrt=False)(function)
        return compiled
    others, config.CACHE_DIR = config.CACHE_DIR, CACHE_FOLDER  # numba settles a function's folder here and now.
    try:
        compiled = njit(nogil=True, cache=True, _nrt=False)(function)
    finally:
        config.CACHE_DIR = others
    return compiled


if TYPE_CHECKING or config.DISABLE_JIT:

    def cpu_ns(room: Any) -> int:
        """CPU time of this thread, nanoseconds; room: Int64[2]."""
        return time.thread_time_ns()

else:
    # Called as it is: a clock of Python's would cost 30 ms in each process.
    _clock_gettime = types.ExternalFunction("clock_gettime", types.int32(types.int32, types.CPointer(types.int64)))

    @kernel
    def cpu_ns(room):
        """CPU time of this thread, nanoseconds; room: Int64[2]."""
        _clock_gettime(time.CLOCK_THREAD_CPUTIME_ID, room.ctypes)
        return room[0] * 1_000_000_000 + room[1]
