"""The runs of a study: what is missing is made, what is done is skipped, what was stopped is resumed."""

from __future__ import annotations

import itertools
import shutil
import string
import subprocess
import sys
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dore.errors import ExitCode, InputError
from dore.files import CONFIG_FILE, DONE_FILE, ROWS_FILE
from dore.report.frame import Spec

RUN_KINDS = ("train", "evaluate", "program")


@dataclass(frozen=True)
class StudyRun:
    """One run. makes: the file that says it is done. model: the weights that an evaluation depends on."""

    kind: str
    folder: Path
    words: tuple[str, ...]
    makes: Path
    model: Path | None = None

    @property
    def done(self) -> bool:
        """Whether nothing is left to do; an evaluation of weights that have changed since is not done."""
        return self.makes.exists() and not self.outdated

    @property
    def outdated(self) -> bool:
        """Whether the model is newer than the evaluation of it."""
        weights, config = _weights(self.model), self.folder / CONFIG_FILE
        return weights is not None and config.exists() and weights.stat().st_mtime > config.stat().st_mtime

    def command(self) -> list[str]:
        """What makes or resumes it."""
        if self.kind == "program":
            return [sys.executable, "-m", *self.words]
        start = [sys.executable, "-c", f"from dore.app.cli import {self.kind}; {self.kind}()"]
        if self.kind == "train":
            return [*start, f"run_dir={self.folder}", "existing=continue", "logger=none", *self.words]
        if (self.folder / CONFIG_FILE).exists():
            return [*start, f"resume={self.folder}"]
        return [*start, f"run_dir={self.folder}", *self.words]


def _weights(model: Path | None) -> Path | None:
    """The file of a model that is a file or a run's folder, if it is there."""
    path = model / "model.safetensors" if model is not None and model.is_dir() else model
    return path if path is not None and path.exists() else None


def jobs_of(spec: Spec, root: Path) -> Iterator[list[StudyRun]]:
    """The jobs of each entry of a study's `runs`, which may run side by side.

    Raises:
        InputError: an entry of no known kind, or a name in it that the study does not give.
    """
    given = spec.get("given", {})
    for number, entry in enumerate(spec.get("runs", [])):
        kind = next((kind for kind in RUN_KINDS if kind in entry), None)
        if kind is None:
            raise InputError(f"runs.{number}: got {', '.join(entry)}, want one of {', '.join(RUN_KINDS)}")
        try:
            yield [_job(kind, entry, names, root) for names in _products(given, entry.get("each", []))]
        except KeyError as error:
            raise InputError(f"runs.{number}: no {error} in `given`") from None


def _products(given: Spec, each: list[str]) -> Iterator[dict[str, Any]]:
    """Every combination of what the names in `each` may be; a mapping's keys bring their own names with them."""
    plain = {name: value for name, value in given.items() if name not in each}
    choices = []
    for name in each:
        value = given[name]
        options = value.items() if isinstance(value, Mapping) else [(one, {}) for one in value]
        choices.append([{name: option, **more} for option, more in options])
    for chosen in itertools.product(*choices):
        yield plain | {name: value for one in chosen for name, value in one.items()}


def _job(kind: str, entry: Spec, names: Spec, root: Path) -> StudyRun:
    shown = {name: "null" if value is None else value for name, value in names.items()}
    folder = root / _filled(entry[kind], shown)
    words = tuple(_words(entry.get("overrides", []), shown | {"root": root, "folder": folder}))
    model = _filled(entry["model"], shown | {"root": root}) if "model" in entry else None
    makes = folder / {"train": DONE_FILE, "evaluate": ROWS_FILE}.get(kind, str(entry.get("makes", "")))
    return StudyRun(
        kind,
        folder,
        (*words, f"model={model}") if model else words,
        makes,
        Path(model) if model else None,
    )


def _words(templates: list[str], names: Spec) -> Iterator[str]:
    """The overrides; one that is only the name of a list stands for all in it."""
    for template in templates:
        value = names.get(template[1:-1]) if template[:1] == "{" else None
        yield from map(str, value) if isinstance(value, list) else [_filled(template, names)]


def _filled(template: str, names: Spec) -> str:
    return string.Formatter().vformat(template, (), names)


def make_missing(spec: Spec, root: Path, at_a_time: int) -> int:
    """Make every run of a study that is missing; a job that fails is named, and the others continue.

    Args:
        root: the folder below which the runs lie.
        at_a_time: jobs side by side.

    Returns:
        The exit code: 0, or the highest of the jobs that failed.
    """
    code = 0
    for jobs in jobs_of(spec, root):
        todo = [job for job in jobs if not job.done]
        print(
            f"{len(jobs) - len(todo)} of {len(jobs)} runs like {jobs[0].folder if jobs else root} are done", flush=True
        )
        with ThreadPoolExecutor(at_a_time) as pool:
            code = max([code, *pool.map(_run, todo)])
        if code == ExitCode.STOPPED:
            return code
    return code


def _run(job: StudyRun) -> int:
    if job.model is not None and _weights(job.model) is None:
        print(f"{job.folder}: left out, {job.model} holds no model", file=sys.stderr)
        return 0
    if job.outdated:
        shutil.rmtree(job.folder)
    print(f"== {job.folder}", flush=True)
    code = subprocess.run(job.command(), check=False).returncode
    if code:
        print(f"{job.folder}: ended with exit code {code}", file=sys.stderr)
    return ExitCode.STOPPED if code < 0 else code
