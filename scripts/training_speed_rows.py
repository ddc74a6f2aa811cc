"""The lines of scripts/bench_training.py, those of one name added up."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from dore.errors import InputError

SAME = (
    "overrides",
    "board",
    "obstacles",
    "batch_size",
    "num_envs",
    "processes",
    "threads",
    "torch",
    "machine",
    "cores",
)
"""What lines of one name must agree in."""
SUMS = ("seconds", "cpu_seconds", "env_steps", "updates")


class Speed:
    """One run's speed over all rounds in which it was measured.

    Args:
        lines: of one name, one a round.

    Raises:
        InputError: they are not of the same run.
        KeyError, TypeError: a line lacks something, or it is of another kind.
    """

    def __init__(self, lines: list[dict[str, Any]]) -> None:
        first = lines[0]
        self.name: str = first["name"]
        for key in SAME:
            if any(line[key] != first[key] for line in lines):
                raise InputError(f"{self.name}: measured with different {key}, want another folder for another run")
        self.about = {key: first[key] for key in SAME}
        self.commits = {str(line["commit"]) for line in lines}
        self.loads = [float(load) for line in lines for load in line["load"]]
        self.rounds = len(lines)
        self.seconds, self.cpu_seconds, env_steps, updates = (sum(line[key] for line in lines) for key in SUMS)
        stages = {stage: sum(line["stages"][stage] for line in lines) for stage in first["stages"]}
        self.shares: dict[str, float] = {stage: taken / self.seconds for stage, taken in stages.items()}
        self.env_steps_per_s = env_steps / self.seconds
        self.updates_per_s = updates / self.seconds
        self.samples_per_s = self.updates_per_s * first["batch_size"]
        rates = [line["env_steps"] / line["seconds"] for line in lines]
        self.slowest, self.fastest = min(rates), max(rates)

    @property
    def of_core(self) -> float:
        """CPU time over wall time of a process, for each of its threads: what other programs took is missing."""
        return float(self.cpu_seconds / self.seconds / self.about["threads"])


def read_speeds(path: str | os.PathLike[str]) -> dict[str, Speed]:
    """The runs of a file by name, in the order in which they come.

    Raises:
        InputError: no such file, a line that is none of scripts/bench_training.py's, or no lines.
    """
    lines: dict[str, list[dict[str, Any]]] = {}
    try:
        for text in Path(path).read_text(encoding="utf-8").splitlines():
            line = json.loads(text)
            lines.setdefault(line["name"], []).append(line)
        speeds = {name: Speed(group) for name, group in lines.items()}
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: want lines of scripts/bench_training.py ({error!r})") from None
    if not speeds:
        raise InputError(f"{path}: nothing is measured yet")
    return speeds
