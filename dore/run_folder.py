"""A run's own folder: config, metrics, checkpoint, model. It is claimed once and never written over silently."""

from __future__ import annotations

import csv
import json
import os
import shutil
import subprocess
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any, cast

import yaml
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from dore.errors import InputError, atomic_write, path_of

CONFIG, METRICS, CHECKPOINT, DONE = "config.yaml", "metrics.csv", "checkpoint.pt", "done.json"
_PACKAGES = ("torch", "torchrl", "tensordict", "numpy", "hydra-core")


@contextmanager
def claimed(path: object, worth: str) -> Iterator[Path]:
    """A new run folder; it is removed again if the block fails before the file `worth` is there.

    So a run that could not start leaves its name free.

    Raises:
        InputError: it exists and holds something.
        OSError: it cannot be made.
    """
    folder = path_of("run_dir", path)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"run_dir: {folder} exists already, want a new one (or resume={folder})")
    folder.mkdir(parents=True, exist_ok=True)
    try:
        yield folder
    except BaseException:
        if not (folder / worth).exists():
            shutil.rmtree(folder, ignore_errors=True)
        raise


def write_config(folder: Path, cfg: DictConfig) -> None:
    """Keep the resolved config, and what made the run."""
    with atomic_write(folder / CONFIG) as file:
        file.write(OmegaConf.to_yaml(cfg, resolve=True))
    versions = {name: version(name) for name in _PACKAGES}
    about = {"started": time.strftime("%Y-%m-%dT%H:%M:%S%z"), "commit": commit(), "versions": versions}
    with atomic_write(folder / "about.json") as file:
        json.dump(about, file, indent=2)


def read_config(folder: str | os.PathLike[str], expected: Iterable[str] = ()) -> DictConfig:
    """The config of a run folder, which must have the `expected` keys.

    Raises:
        InputError: no run folder.
    """
    path = Path(folder) / CONFIG
    try:
        cfg = OmegaConf.load(path)
    except FileNotFoundError:
        raise InputError(f"resume: {folder} is no run folder, it has no {CONFIG}") from None
    except (OmegaConfBaseException, ValueError, yaml.YAMLError) as error:
        raise InputError(f"{path}: damaged ({' '.join(str(error).split())})") from None
    missing = [key for key in expected if not isinstance(cfg, DictConfig) or key not in cfg]
    if missing:
        raise InputError(f"{path}: damaged or cut off, it lacks {', '.join(missing)}")
    return cast(DictConfig, cfg)


def mark_done(folder: Path, result: Mapping[str, Any]) -> None:
    """Write the file that says a run has ended, and how."""
    with atomic_write(folder / DONE) as file:
        json.dump(result, file, indent=2)


def unmark_done(folder: Path) -> None:
    """A run that goes on has not ended."""
    (folder / DONE).unlink(missing_ok=True)


class MetricsLog:
    """metrics.csv, a row at a time, flushed: a killed run keeps all but its last line."""

    def __init__(self, path: Path, columns: tuple[str, ...], keep_until: int | None = None) -> None:
        """keep_until: the iteration that a resumed run goes on from; later rows are dropped. None: a new file."""
        self.columns = columns
        kept = [] if keep_until is None else self._rows_until(path, keep_until)
        with atomic_write(path) as file:
            csv.DictWriter(file, columns).writeheader()
            csv.DictWriter(file, columns).writerows(kept)
        self._file = open(path, "a", encoding="utf-8", newline="")  # noqa: SIM115
        self._writer = csv.DictWriter(self._file, columns)

    def write(self, row: Mapping[str, object]) -> None:
        """Add a row; None is left empty."""
        self._writer.writerow(row)
        self._file.flush()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    @staticmethod
    def _rows_until(path: Path, iteration: int) -> list[dict[str, str]]:
        if not path.exists():
            return []
        with open(path, encoding="utf-8", errors="replace", newline="") as file:
            rows = list(csv.DictReader(file))
        return [row for row in rows if (row["iteration"] or "").isdigit() and int(row["iteration"]) <= iteration]


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
