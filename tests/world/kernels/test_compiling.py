"""Compiled kernels: as plain Python, from the cache, with other threads and processes, and stopped."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from dore.errors import InputError
from dore.planners.exact import Exact
from dore.world.generator import Difficulty
from dore.world.instances import InstanceSet
from dore.world.kernels import compiling
from dore.world.kernels.tables import MAX_WORDS, table_of
from tests.drawings import wide_hand

PACKAGE = Path(compiling.__file__).parent
FOUND = """
from dore.learn.corridor_features import corridor_planes
from dore.planners.exact import Exact
from dore.planners.graph_search import GraphSearch
from dore.world.generator import Difficulty
from dore.world.instances import InstanceSet
from tests.drawings import wide_hand
for size in (5, 9):
    reach = wide_hand(size, size)
    batch = InstanceSet.generate(reach, 6, Difficulty(4, size), "test", 3).batch()
    print(corridor_planes(reach, *batch).nonzero().sum())
    for planner in (Exact(reach, 1000, 60.0, 100.0), GraphSearch(reach, 20, 60.0)):
        for plan in planner.raw_plans(batch):
            print(plan.status, plan.moves, plan.expansions, plan.reason, plan.lower_bound)
"""


def found(**environment: str) -> str:
    """What a new process finds for some boards of one and two words."""
    env = os.environ | environment
    done = subprocess.run([sys.executable, "-c", FOUND], capture_output=True, text=True, check=True, env=env)
    assert "Warning" not in done.stderr
    return done.stdout


def test_plain_python_finds_the_same() -> None:
    compiled = found()
    assert compiled.count("solved") > 10
    assert found(NUMBA_DISABLE_JIT="1") == compiled


def test_a_changed_kernel_has_a_cache_of_its_own(tmp_path: Path) -> None:
    copy = tmp_path / "kernels"
    shutil.copytree(PACKAGE, copy)
    before = compiling.digest_of(copy)
    assert before == compiling.digest_of(PACKAGE)
    with (copy / "bits.py").open("a") as file:
        file.write("# changed\n")
    assert compiling.digest_of(copy) != before


def test_the_cache_is_where_it_can_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = compiling._cache_folder()
    assert folder is not None
    assert Path(folder).parent == tmp_path
    assert Path(folder).stat().st_mode & 0o077 == 0
    Path(folder).chmod(0o777)
    assert compiling._cache_folder() != folder, "another user could write what we run"


def test_without_a_cache_kernels_run_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", "/proc/none")
    monkeypatch.setattr(tempfile, "tempdir", "/proc/none")
    monkeypatch.setattr(compiling.config, "CACHE_DIR", "")
    assert compiling._cache_folder() is None
    monkeypatch.setattr(compiling, "CACHE_FOLDER", None)

    @compiling.entry
    def twice(number: int) -> int:
        return 2 * number

    assert twice(21) == 42


def hard(rows: int) -> tuple[Exact, InstanceSet]:
    """Boards that take from a millisecond to a second."""
    reach = wide_hand(8, 8)
    return Exact(reach, 10**7, 60.0, 500.0), InstanceSet.generate(reach, rows, Difficulty(28, 28), "test", 1)


def test_threads_and_forked_processes_find_the_same() -> None:
    planner, instances = hard(12)
    alone = [planner.find(instances.batch(slice(row, row + 1))).n_moves[0] for row in range(12)]
    assert max(alone) > 8
    with ThreadPoolExecutor(4) as pool:
        threads = list(pool.map(lambda row: planner.find(instances.batch(slice(row, row + 1))).n_moves[0], range(12)))
    assert threads == alone
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    process = context.Process(target=lambda: queue.put(planner.find(instances.batch()).n_moves.tolist()))
    process.start()
    assert queue.get(timeout=60) == alone
    process.join()


def test_ctrl_c_is_heard_at_once() -> None:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # What starts in the background ignores it.
    reach = wide_hand(8, 8)
    planner, batch = Exact(reach, 10**9, 60.0, 500.0), InstanceSet.generate(reach, 38, Difficulty(32, 32), "test", 1)
    planner.find(batch.batch(slice(1)))
    sent: list[float] = []

    def send() -> None:
        sent.append(time.process_time())
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(0.5, send)
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        planner.find(batch.batch(slice(37, 38)))
    assert time.process_time() - sent[0] < 0.2
    timer.join()
    signal.signal(signal.SIGINT, before)


def test_more_cells_than_the_kernels_hold_are_refused() -> None:
    n_cells = 64 * MAX_WORDS + 1
    sets = np.zeros((1, n_cells, MAX_WORDS + 1), np.uint64)
    with pytest.raises(InputError, match="layout: got 1,025 cells, want 1,024 at most"):
        table_of(sets, np.ones(n_cells, np.bool_), n_cells)


def test_the_first_compilation_is_announced_on_a_terminal(capsys, monkeypatch):
    monkeypatch.setattr(compiling.NOTICE, "announced", False)
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    for lines in (1, 0):
        compiling.kernel(lambda a: a + 1)(1)
        assert len(capsys.readouterr().err.splitlines()) == lines
    monkeypatch.setattr(compiling.NOTICE, "announced", False)
    monkeypatch.setattr("sys.stderr.isatty", lambda: False)
    compiling.kernel(lambda a: a + 2)(1)
    assert capsys.readouterr().err == ""
