"""Measures `exact` in CPU seconds of one thread, alone and in turn with that of an earlier commit.

python -m scripts.bench_planners out=FOLDER [parts=[latency,decided,growth,throughput,cold,against,agreement]] [limit=N]
FOLDER/PART/rows.csv has a row a board; `dore-report study=planners` makes the page. Milliseconds: `search_ms` of one
call from Python, `kernel_ms` of its compiled part, `plan_ms` with replay and `Plan`; `old_ms`: the earlier search.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any, NamedTuple

from tqdm import tqdm

from dore.app import build
from dore.errors import InputError
from dore.files import conf_dir
from dore.planners.base import parts_of
from dore.planners.exact import Exact
from dore.report.measurements import write_measurements
from dore.world.generator import Difficulty, FreshInstances
from dore.world.problem import Batch
from dore.world.reach import Reach
from scripts.program import composed, run

Rows = list[dict[str, Any]]
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

    def __str__(self) -> str:
        obstacles = f"{self.low}" if self.low == self.high else f"{self.low}-{self.high}"
        return f"{self.rows} x {self.cols}, {obstacles}{'' if self.reach == 'wide_hand' else f', {self.reach}'}"

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
HARD += [dense(n, n, percent) for n, percent in product((12, 14, 16), (30, 40))]
GROWING = [dense(n, n, 15) for n in (6, 8, 10, 12, 14, 16, 24, 32)]
GROWING += [dense(8, 8, percent) for percent in (9, 20, 30, 41, 50, 59)]
WORLDS = [*product([(3, 6), *((n, n) for n in range(5, 11))], ("wide_hand", "paper_fit", "published"))]
WORLDS += [((3, 6), "panda_slim"), ((3, 6), "jaco"), ((3, 4), "panda")]
ALL = [dense(*size, percent, reach) for (size, reach), percent in product(WORLDS, range(10, 70, 10))]


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
        try:
            made = subprocess.run(["git", "archive", commit], cwd=conf_dir().parent, check=True, capture_output=True)
        except subprocess.CalledProcessError:
            raise InputError(f"commit: {commit} is not in this checkout") from None
        subprocess.run(["tar", "-x", "-C", folder], input=made.stdout, check=True)
        yield {"env": {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": folder}, "cwd": folder}


def boards(
    sets: list[Boards], n: int, limits: tuple[int, float, float], options: Options, old: bool = False, size: int = 1
) -> Rows:
    """A row a board, `size` of them planned at once; up to 500 of a set with few and many obstacles.

    old: the earlier commit plans each set between two times that this one does; the mean of both counts.
    """
    rows: Rows = []
    with ExitStack() as stack:
        if old:
            there = stack.enter_context(earlier(options.commit))
            pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
            process = stack.enter_context(subprocess.Popen([sys.executable, "-c", OLD], **there, **pipes))
        for one in tqdm(sets, unit="set"):
            try:
                reach, batch = one.draw(min(options.limit, n if one.low == one.high else 500))
            except InputError:  # So few obstacles block no target, or so many leave no move.
                continue
            planner, parts = Exact(reach, *limits), parts_of(batch, size)
            planner.plan(parts[0])[0]
            found = [row for part in parts for row in planned(planner, part)]
            if old:
                layout, given = reach.layout, [[field.tolist() for field in part] for part in parts]
                print(
                    json.dumps([layout.cells, layout.cell_m, reach.to_dict(), limits, given]),
                    file=process.stdin,
                    flush=True,
                )
                for row, theirs in zip(found, json.loads(process.stdout.readline()), strict=True):
                    row.update(theirs)
                for row, again in zip(found, [row for part in parts for row in planned(planner, part)], strict=True):
                    row["search_ms"] = (row["search_ms"] + again["search_ms"]) / 2
            rows += [{"boards": str(one), **row} for row in found]
        if old:
            process.stdin.close()
    return rows


def planned(planner: Exact, batch: Batch) -> Rows:
    """Boards searched, and planned, at once; the seconds are shared out evenly but for the compiled part's."""
    began = process_time()
    found = planner.find(batch)
    middle = process_time()
    plans = list(planner.plan(batch))
    ms = {"search_ms": 1000 * (middle - began) / len(plans), "plan_ms": 1000 * (process_time() - middle) / len(plans)}
    memory = {"memory_mb": int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20}
    return [
        {"status": str(plan.status), "moves": len(plan.moves), "kernel_ms": ns / 1e6, **ms, **memory}
        for plan, ns in zip(plans, found.cpu_ns.tolist(), strict=True)
    ]


def throughput(options: Options) -> Rows:
    """All boards of a set at once, six times: the searches; with replay; and with each `Plan` made."""
    reach, batch = Boards(8, 8, 3, 13).draw(options.limit)
    planner, rows = Exact(reach, 10**7, 5.0, 2048.0), []
    ways = {
        "search": planner.find,
        "with replay": planner.plan,
        "with each Plan made": lambda all: [*planner.plan(all)],
    }
    for _, (name, work) in product(range(6), ways.items()):
        began = process_time()
        work(batch)
        rows.append({"what": name, "plans": len(batch.target), "seconds": process_time() - began})
    return rows


def cold(options: Options) -> Rows:
    """dore-plan of both commits in turn, seven times after one that does not count: CPU seconds of the process."""
    rows = []
    with earlier(options.commit) as there:
        words = [
            f"scene={conf_dir()}/scenes/fig7.json",
            "planner=exact",
            "reach=wide_hand",
            f"out={there['cwd']}/p.json",
        ]
        for _, (name, package, where) in product(range(8), (("earlier", "", there), ("now", "app.", {}))):
            before = os.times()
            subprocess.run(
                [sys.executable, "-c", PLAN.format(package), *words], **where, check=True, capture_output=True
            )
            seconds = sum(after - began for after, began in zip(os.times()[2:4], before[2:4], strict=True))
            rows.append({"commit": name, "seconds": seconds})
    return rows[2:]


PARTS: dict[str, Callable[[Options], Rows]] = {
    "latency": partial(boards, TEN, 120, (10**7, 5.0, 2048.0)),
    "decided": partial(boards, HARD, 300, (10**7, 0.5, 2048.0)),
    "growth": partial(boards, GROWING, 25, (10**7, 4.0, 2048.0)),
    "throughput": throughput,
    "cold": cold,
    "against": partial(boards, SIX, 120, (10**7, 5.0, 1500.0), old=True),
    "agreement": partial(boards, ALL, 140, (500, 60.0, 1500.0), old=True, size=140),
}


if __name__ == "__main__":
    sys.exit(run(main, Options))
