"""Makes the benchmark again, and compares it with the file in the package.

python -m scripts.make_benchmark [out=FILE.npz] [counts=FILE.csv] [overrides=[instances.seed=1]]
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from dore.configure import make
from dore.errors import InputError
from dore.files import atomic_write
from dore.world import strata
from dore.world.benchmark import SHIPPED, STRATA, Benchmark, World, digest, read
from scripts.program import composed, run


@dataclass(frozen=True)
class Options:
    """out: where the file is written, if anywhere. counts: a CSV file of how many boards there are. overrides: of the
    config, as dore-evaluate takes them."""

    out: str | None = None
    counts: str | None = None
    overrides: list[str] = field(default_factory=list)


def main(options: Options) -> int:
    """Make it, print what each world has, and the digest; 1 where the file in the package holds something else."""
    cfg = composed("evaluate", "instances=benchmark", *options.overrides)
    benchmark: Benchmark = make(cfg.instances, "instances")
    began = time.process_time()
    print(" ".join(["layout reach density".ljust(22), *(name.rjust(10) for name in STRATA), "left out, of boards"]))
    every: list[dict[str, object]] = []
    worlds = strata.make(benchmark, lambda world, made: every.extend(report(world, made)))
    name, n_boards = digest(worlds), sum(map(len, worlds.values()))
    print(f"{n_boards:,} boards, {time.process_time() - began:.0f} CPU s, sha256 {name}")
    if options.out is not None:
        write(options.out, worlds)
    if options.counts is not None:
        Path(options.counts).parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(options.counts) as file:
            pd.DataFrame(every).to_csv(file, index=False, lineterminator="\n")
    known = read(SHIPPED) if SHIPPED.exists() else {}
    differing = [world for world, rows in worlds.items() if not np.array_equal(rows, known.get(world))]
    print(f"{len(worlds) - len(differing)} of {len(worlds)} worlds are as in {SHIPPED.name}")
    return 1 if differing else 0


def report(world: World, made: strata.Made) -> list[dict[str, object]]:
    """Print how many boards each stratum of a world has; a row for each."""
    counts = " ".join(f"{len(stratum):>10}" for stratum in made.strata)
    short = f" ({made.left_out_short} may need fewer than {strata.LONG} moves)" if made.left_out_short else ""
    print(f"{world!s:<22} {counts} {made.left_out}{short}, {made.candidates:,}", flush=True)
    about = {**world._asdict(), "left_out": made.left_out, "left_out_short": made.left_out_short}
    return [
        {**about, "candidates": made.candidates, "stratum": name, "boards": len(stratum)}
        for name, stratum in zip(STRATA, made.strata, strict=True)
    ]


def write(path: str, worlds: dict[str, np.ndarray]) -> None:
    """Write a benchmark's file.

    Raises:
        InputError: a name that is not NAME.npz.
    """
    if not path.endswith(".npz"):
        raise InputError(f"out: got {path}, want NAME.npz")
    with atomic_write(path, "wb") as file:
        np.savez_compressed(file, **worlds)


if __name__ == "__main__":
    sys.exit(run(main, Options))
