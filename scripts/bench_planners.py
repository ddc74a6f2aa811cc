"""Measures `exact` in CPU time of one thread, alone and in turn with that of an earlier commit.

python -m scripts.bench_planners out=FOLDER [parts=[latency,decided,...]] [limit=N]
FOLDER/PART/rows.csv has a row a board; `dore-report study=planners` makes the page. Milliseconds of a search:
`kernel_ms` of its compiled part, `search_ms` of the call from Python, `replay_ms` with the replay, `plan_ms` with a
`Plan`; `old_ms` of the earlier search.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import islice, product
from pathlib import Path
from resource import getpagesize
from subprocess import PIPE
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any, NamedTuple

from tqdm import tqdm

from dore.app import build
from dore.errors import InputError
from dore.files import conf_dir
from dore.planners.base import parts_of
from dore.planners.compiled import STATUS
from dore.planners.exact import Exact
from dore.report.measurements import write_measurements
from dore.world.generator import Difficulty, FreshInstances
from dore.world.plan import Status
from dore.world.problem import Batch
from dore.world.reach import Reach
from scripts.program import composed, run

Rows = list[dict[str, Any]]
Limits = tuple[int, float, float]
"""Nodes, CPU seconds (wall seconds of the earlier commit) and MiB."""
PLAN = "import sys; from dore.{}cli import plan; sys.argv[:1] = ['dore-plan']; plan()"
OLD = """
import json, sys, time, torch
from dore.layout import Layout
from dore.planners.exact import Exact
from dore.reach import Reach
from dore.sampling import Batch
torch.set_num_threads(1)
for line in sys.stdin:
    cells, cell_m, reach, limits, parts = json.loads(line)
    planner, done = Exact(Reach(Layout(tuple(map(tuple, cells)), cell_m), **reach), *limits), []
    for batch in [Batch(*map(torch.tensor, part)) for part in parts]:
        began = time.process_time()
        drafts = planner._drafts(batch)
        ms = 1000 * (time.process_time() - began) / len(drafts)
        done += [{"old_ms": ms, "old_status": draft.status, "old_moves": len(draft.moves)} for draft in drafts]
    print(json.dumps(done), flush=True)
"""
"""What a process of the earlier commit does: a line a set of boards, in and out."""


class Boards(NamedTuple):
    """rows x cols cells, from `low` to `high` obstacles, under a reach of conf/."""

    rows: int
    cols: int
    low: int
    high: int
    reach: str = "wide_hand"

    def draw(self, n: int) -> tuple[Reach, Batch]:
        """The reach, and `n` instances of the test split."""
        size = [f"layout.rows={self.rows}", f"layout.cols={self.cols}", *["layout.front_m=0.57"] * (self.rows > 12)]
        reach = build.reach_of(composed("evaluate", f"reach={self.reach}", "layout=3x6", *size), "cpu")
        return reach, FreshInstances(reach, Difficulty(self.low, self.high), "test", 1).draw(n)


def dense(rows: int, cols: int, percent: int, reach: str = "wide_hand") -> Boards:
    """Boards of that many obstacles per 100 cells."""
    return Boards(rows, cols, *2 * (max(1, rows * cols * percent // 100),), reach)


SIX = [Boards(6, 6, 3, 8), Boards(8, 8, 3, 13), dense(8, 8, 30), dense(8, 8, 40), dense(10, 10, 30)]
SIX.append(Boards(3, 6, 10, 10, "paper_fit"))
TEN = [*SIX, dense(10, 10, 20), dense(10, 10, 40), Boards(3, 6, 10, 10), Boards(3, 6, 10, 10, "panda_slim")]
HARD = [dense(n, n, percent) for n, percent in product((8, 10), (30, 40, 50))]
HARD += [Boards(3, 6, n, n, reach) for n, reach in product((9, 10), ("wide_hand", "paper_fit"))]
LARGE = [dense(n, n, percent) for n, percent in product((12, 14, 16), (30, 40))]
GROWING = [dense(n, n, 15) for n in (6, 8, 10, 12, 14, 16, 24, 32)]
GROWING += [dense(8, 8, percent) for percent in (9, 20, 30, 41, 50, 59)]
WORLDS = [*product([(3, 6), *((n, n) for n in range(5, 11))], ("wide_hand", "paper_fit", "published"))]
WORLDS += [((3, 6), "panda_slim"), ((3, 6), "jaco"), ((3, 4), "panda")]
ALL = [dense(*size, percent, reach) for (size, reach), percent in product(WORLDS, range(10, 70, 10))]
MANY = ((30, 330), (50, 110), (100, 20))
"""Up to how many cells how many instances of a set are compared: the earlier search of a large one takes long."""


@dataclass(frozen=True)
class Options:
    """out: the folder of the rows. limit: instances of a set at most. commit: the earlier one."""

    out: Path
    parts: list[str] = field(default_factory=lambda: list(PARTS))
    limit: int = 10_000
    commit: str = "dd256bb"

    def __post_init__(self) -> None:
        if unknown := [name for name in self.parts if name not in PARTS]:
            raise InputError(f"parts: got {', '.join(unknown)}, want some of {', '.join(PARTS)}")


def main(options: Options) -> None:
    """Run the parts that are asked for; write their rows."""
    for part in options.parts:
        load = f"{os.getloadavg()[0]:.2f}"
        write_measurements(options.out / part, PARTS[part](options), load_before=load, earlier=options.commit)


@contextmanager
def earlier(commit: str) -> Iterator[dict[str, Any]]:
    """What a process needs so that its `dore` is that of the earlier commit."""
    with TemporaryDirectory() as folder:
        made = subprocess.run(["git", "archive", commit], cwd=conf_dir().parent, capture_output=True)
        if made.returncode:
            raise InputError(f"commit: {commit} is not in this checkout")
        subprocess.run(["tar", "-x", "-C", folder], input=made.stdout, check=True)
        yield {"env": {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": folder}, "cwd": folder}


def boards(sets: list[Boards], n: int, size: int, limits: Limits, old: bool, options: Options) -> Rows:
    """A row a board, `size` of them at once. A set in which no target is blocked, or nothing can move, has none.

    old: the earlier commit plans each set between two times that this one does; the mean of both counts.
    """
    rows: Rows = []
    with ExitStack() as stack:
        if old:
            there, pipes = stack.enter_context(earlier(options.commit)), {"stdin": PIPE, "stdout": PIPE, "text": True}
            other = stack.enter_context(subprocess.Popen([sys.executable, "-c", OLD], **there, **pipes))
        for one in tqdm(sets, unit="set"):
            with suppress(InputError):
                reach, batch = one.draw(min(options.limit, n))
                planner, parts = Exact(reach, *limits), parts_of(batch, size)
                planner.plan(parts[0])
                found = searched(planner, parts)
                if old:
                    given = [[field.tolist() for field in part] for part in parts]
                    world = [reach.layout.cells, reach.layout.cell_m, reach.to_dict(), limits]
                    print(json.dumps([*world, given]), file=other.stdin, flush=True)
                    again = searched(planner, parts)
                    for row, theirs, second in zip(found, json.loads(other.stdout.readline()), again, strict=True):
                        row |= theirs | {key: (row[key] + second[key]) / 2 for key in ("search_ms", "kernel_ms")}
                add_plans(planner, parts, found)
                n_obstacles = f"{one.low}" if one.low == one.high else f"{one.low}-{one.high}"
                names = {"cells": f"{one.rows} x {one.cols}", "obstacles": n_obstacles, "reach": one.reach}
                rows += [names | row for row in found]
    return rows


def compared(options: Options) -> Rows:
    """All layouts up to 10 x 10, all reaches and densities, with this search and with the earlier one."""
    rows, least = [], 0
    for most, n in MANY:
        sets = [one for one in ALL if least < one.rows * one.cols <= most]
        rows += boards(sets, n, n, (20, 60.0, 1500.0), True, options)
        least = most
    return rows


def searched(planner: Exact, parts: list[Batch]) -> Rows:
    """A search of each part, and nothing else between two; its time is shared out evenly, but for the compiled part's.

    Memory is that of the whole process.
    """
    rows: Rows = []
    for part in parts:
        began = process_time()
        found = planner.find(part)
        ms, n = 1000 * (process_time() - began), len(part.target)
        mb = int(Path("/proc/self/statm").read_text().split()[1]) * getpagesize() / 2**20
        ends = zip(found.outcome.tolist(), found.n_moves.tolist(), found.cpu_ns.tolist(), strict=True)
        for outcome, moves, ns in ends:
            status = str(STATUS.get(outcome, Status.GAVE_UP))
            times = {"kernel_ms": ns / 1e6, "search_ms": ms / n}
            rows.append({"status": status, "moves": moves, "memory_mb": mb, **times})
    return rows


def add_plans(planner: Exact, parts: list[Batch], rows: Rows) -> None:
    """The times of a search with the replay, and with a `Plan` of each, of parts that are not given up throughout."""
    ends = iter(rows)
    for part in parts:
        of_part = list(islice(ends, len(part.target)))
        times = dict.fromkeys(("replay_ms", "plan_ms"))
        if any(row["status"] != Status.GAVE_UP for row in of_part):
            began = process_time()
            plans = planner.plan(part)
            times["replay_ms"] = 1000 * (process_time() - began) / len(plans)
            list(plans)
            times["plan_ms"] = 1000 * (process_time() - began) / len(plans)
        for row in of_part:
            row |= times


def cold(options: Options) -> Rows:
    """dore-plan of both commits in turn, three times after one that does not count: CPU seconds of the process."""
    rows = []
    with earlier(options.commit) as there:
        scene, out = f"scene={conf_dir()}/scenes/fig7.json", f"out={there['cwd']}/p.json"
        words = [scene, out, "planner=exact", "reach=wide_hand"]
        for _, (name, package, how) in product(range(4), (("earlier", "", there), ("now", "app.", {}))):
            before = os.times()
            subprocess.run([sys.executable, "-c", PLAN.format(package), *words], **how, check=True, capture_output=True)
            seconds = sum(os.times()[2:4]) - sum(before[2:4])
            rows.append({"commit": name, "seconds": seconds})
    return rows[2:]


PARTS: dict[str, Callable[[Options], Rows]] = {
    "latency": partial(boards, TEN, 200, 1, (10**7, 5.0, 2048.0), False),
    "decided": partial(boards, HARD, 200, 1, (10**7, 0.5, 2048.0), False),
    "larger": partial(boards, LARGE, 50, 1, (10**7, 0.5, 2048.0), False),
    "growth": partial(boards, GROWING, 15, 1, (10**7, 4.0, 2048.0), False),
    "throughput": partial(boards, 5 * [Boards(8, 8, 3, 13)], 10_000, 10_000, (10**7, 5.0, 2048.0), False),
    "cold": cold,
    "against": partial(boards, SIX, 60, 1, (10**7, 5.0, 1500.0), True),
    "agreement": compared,
}


if __name__ == "__main__":
    sys.exit(run(main, Options))
