"""Makes the benchmark: random boards, sorted by their proved optimum into strata, until these are full.

Nothing depends on the machine or on time: random numbers come from a stream that is the same everywhere (PCG64's own
integers), and the search's only budget is nodes. Another search may decide other boards within the same budget; the
file in the package is what counts.

Per setting, up to `max_candidates` random boards are looked at. Those of the test split whose target is blocked, and
that leave a first move, are searched with `quick_nodes`. Where that leaves open whether an unfilled stratum below 7
moves is met, or where 7+ is not full, `max_nodes` are spent. What is still open then is left out, and counted. No
stratum below 7 loses its harder boards by that, as far as the lower bounds of what is left out are 7 and more.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from dore.world.benchmark import STRATA, UNSOLVABLE, Benchmark, Setting, stratum_of
from dore.world.board import pack, unpack
from dore.world.generator import SPLITS, split_share
from dore.world.kernels import slices
from dore.world.kernels.search import search
from dore.world.kernels.tables import unsigned
from dore.world.mirror import mirrored_board, mirrored_cell
from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.rules import has_move, retrievable

AT_ONCE = 2048
"""Boards drawn together."""
LONG = 7
"""The fewest moves of the last stratum of boards that have a plan."""
OPEN = -1
"""In place of an optimum: neither a plan is found, nor proved that there is none."""


class Searched(NamedTuple):
    """optimum: Int64[N], UNSOLVABLE or OPEN among them. fewest: Int64[N], no plan has fewer moves."""

    optimum: np.ndarray
    fewest: np.ndarray


@dataclass
class Made:
    """A setting's rows as they are collected, by stratum, and what was left out.

    candidates: boards drawn. left_out: boards that stayed open; left_out_short: those of them that may have a plan of
    fewer than 7 moves.
    """

    strata: list[list[bytes]] = field(default_factory=lambda: [[] for _ in STRATA])
    candidates: int = 0
    left_out: int = 0
    left_out_short: int = 0

    def rows(self) -> np.ndarray:
        """UInt8[N, K], stratum after stratum."""
        every = [row for stratum in self.strata for row in stratum]
        return np.frombuffer(b"".join(every), np.uint8).reshape(len(every), -1)


def make(benchmark: Benchmark, report: Callable[[Setting, Made], None]) -> dict[str, np.ndarray]:
    """All settings of a benchmark, as its file holds them; `report` is called for each."""
    found = {}
    for setting in benchmark.settings:
        made = make_setting(benchmark, setting)
        report(setting, made)
        found[str(setting)] = made.rows()
    return found


def make_setting(benchmark: Benchmark, setting: Setting) -> Made:
    """The instances of one setting; they do not depend on which other settings there are."""
    reach = benchmark.reach_of(setting.layout, setting.reach)
    n_obstacles = (setting.density * reach.n_cells + 50) // 100
    stream = np.random.PCG64(np.random.SeedSequence([benchmark.seed, *str(setting).encode()]))
    made, seen = Made(), set[bytes]()
    while made.candidates < benchmark.max_candidates and min(map(len, made.strata)) < benchmark.per_stratum:
        batch = _fresh(reach, draw(reach, n_obstacles, stream), seen)
        made.candidates += AT_ONCE
        found = _search(benchmark, reach, batch, made)
        still_open = found.optimum == OPEN
        made.left_out += int(still_open.sum())
        made.left_out_short += int((found.fewest[still_open] < LONG).sum())
        _sort(batch, reach, found.optimum, benchmark.per_stratum, made)
    return made


def draw(reach: Reach, n_obstacles: int, stream: np.random.PCG64) -> Batch:
    """Those of `AT_ONCE` random boards that are instances of the test split."""
    keys = stream.random_raw(AT_ONCE * reach.n_cells).reshape(AT_ONCE, reach.n_cells)
    cells = np.argsort(keys, axis=1, kind="stable")
    occupied = np.zeros((AT_ONCE, reach.n_cells), bool)
    np.put_along_axis(occupied, cells[:, 1 : n_obstacles + 1], True, axis=1)
    board, target = pack(torch.from_numpy(occupied)), torch.from_numpy(cells[:, 0].copy())
    keep = (split_share(board, reach) >= SPLITS["test"][0]) & ~retrievable(reach, board, target)
    board, target = board[keep], target[keep]
    playable = has_move(reach, board, target)
    return Batch(board[playable], target[playable])


def _fresh(reach: Reach, batch: Batch, seen: set[bytes]) -> Batch:
    """Those that are neither in `seen`, nor mirror images of what is there; they are added to it."""
    images = [_bytes(*batch)]
    if reach.mirror is not None:
        images.append(_bytes(mirrored_board(batch.board, reach), mirrored_cell(batch.target, reach)))
    kept = []
    for row, same in enumerate(zip(*images, strict=True)):
        if (key := min(same)) not in seen:
            seen.add(key)
            kept.append(row)
    rows = torch.tensor(kept, dtype=torch.int64)
    return Batch(batch.board[rows], batch.target[rows])


def _bytes(board: Tensor, target: Tensor) -> list[bytes]:
    return [row.tobytes() for row in torch.cat([board, target[:, None]], -1).numpy()]


def _search(benchmark: Benchmark, reach: Reach, batch: Batch, made: Made) -> Searched:
    """Search all a little, and those at length that an unfilled stratum may need."""
    found = searched(reach, batch, benchmark.quick_nodes)
    filled = [len(stratum) >= benchmark.per_stratum for stratum in made.strata]
    wanted = (not filled[STRATA.index("7+")]) | (found.fewest < LONG)
    rows = np.flatnonzero((found.optimum == OPEN) & wanted)
    part = Batch(batch.board[rows], batch.target[rows])
    found.optimum[rows], found.fewest[rows] = searched(reach, part, benchmark.max_nodes)
    return found


def searched(reach: Reach, batch: Batch, nodes: int) -> Searched:
    """What exact search finds within so many nodes."""
    limits = slices.Limits(seconds=1e6, nodes=nodes, megabytes=1e6)
    found = slices.run(search, reach.table, unsigned(batch.board), batch.target.numpy(), limits)
    shut = np.isin(found.outcome, (slices.UNSOLVABLE, slices.LOCKED))
    solved = (found.outcome == slices.SOLVED) & (found.n_moves < UNSOLVABLE)
    return Searched(np.where(solved, found.n_moves, np.where(shut, UNSOLVABLE, OPEN)), found.fewest.copy())


def _sort(batch: Batch, reach: Reach, optimum: np.ndarray, per_stratum: int, made: Made) -> None:
    """Put decided instances into their strata as long as there is room."""
    rows = np.flatnonzero(optimum != OPEN)
    occupied = unpack(batch.board[rows], reach.n_cells).numpy()
    head = np.stack([batch.target[rows].numpy(), optimum[rows]], 1).astype(np.uint8)
    whole = np.concatenate([head, np.packbits(occupied, axis=1, bitorder="little")], 1)
    for row, stratum in zip(whole, stratum_of(head[:, 1]).tolist(), strict=True):
        if len(made.strata[stratum]) < per_stratum:
            made.strata[stratum].append(row.tobytes())
