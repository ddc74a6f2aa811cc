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
from dore.world.benchmark import SHIPPED, STRATA, Benchmark, Setting, digest, read
from scripts.program import composed, run


@dataclass(frozen=True)
class Options:
    """out: where the file is written, if anywhere. counts: a CSV file of how many boards there are. overrides: of the
    config, as dore-evaluate takes them."""

    out: str | None = None
    counts: str | None = None
    overrides: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        if self.out is not None and not self.out.endswith(".npz"):
            raise InputError(f"out: got {self.out}, want NAME.npz")


def main(options: Options) -> int:
    """Make it, print what each setting has, and the digest; 1 where the file in the package holds something else."""
    cfg = composed("evaluate", "instances=benchmark", *options.overrides)
    benchmark: Benchmark = make(cfg.instances, "instances")
    began = time.process_time()
    every: list[dict[str, object]] = []

    def report(setting: Setting, made: strata.Made) -> None:
        every.extend(counts_of(setting, made))
        print(f"{setting}: {sum(map(len, made.strata))} of {made.candidates:,} boards, {made.left_out} left out")

    settings = strata.make(benchmark, report)
    name, n_boards = digest(settings), sum(map(len, settings.values()))
    print(f"{n_boards:,} boards, {time.process_time() - began:.0f} CPU s, sha256 {name}")
    if options.out is not None:
        with atomic_write(options.out, "wb") as file:
            np.savez_compressed(file, **settings)
    if options.counts is not None:
        Path(options.counts).parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(options.counts) as file:
            pd.DataFrame(every).to_csv(file, index=False, lineterminator="\n")
    known = read(SHIPPED) if SHIPPED.exists() else {}
    differing = [setting for setting, rows in settings.items() if not np.array_equal(rows, known.get(setting))]
    print(f"{len(settings) - len(differing)} of {len(settings)} settings are as in {SHIPPED.name}")
    return 1 if differing else 0


def counts_of(setting: Setting, made: strata.Made) -> list[dict[str, object]]:
    """A row for each stratum of a setting: how many boards it has, and how many were left out of it."""
    about = {**setting._asdict(), "left_out": made.left_out, "left_out_short": made.left_out_short}
    return [
        {**about, "candidates": made.candidates, "stratum": name, "boards": len(stratum)}
        for name, stratum in zip(STRATA, made.strata, strict=True)
    ]


if __name__ == "__main__":
    sys.exit(run(main, Options))
