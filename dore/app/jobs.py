"""What the jobs of a sweep (-m) share, whatever the command: names of folders; a finished job is not run again."""

from __future__ import annotations

import hashlib
import re
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override, ValueType
from hydra.experimental.callback import Callback
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf, read_write

from dore.errors import ExitCode, InputError, path_of
from dore.files import read_record, write_record

LONGEST_NAME = 120
QUOTES = "\"'"
JOB_FILE = "job.json"
"""In the folder of a finished job other than a training: its overrides and its exit code."""


def job_name(overrides: Sequence[str], swept: Sequence[str], unnamed: Sequence[str]) -> str:
    """A job's folder: what was swept, the seed last, then its other overrides; no shell and no Hydra needs it quoted.

    Where it is too long it is cut, and a digest of all is added. unnamed: keys that are left out.
    """
    values = {key.lstrip("+~"): value for key, _, value in (one.partition("=") for one in overrides)}
    keys = sorted((key for key in values if key not in unnamed), key=lambda key: (key not in swept, key == "seed", key))
    parts = (f"{key}-{values[key].strip('[]{}() ' + QUOTES)}" for key in keys)
    name = "_".join(re.sub(r"[^A-Za-z0-9.+_-]+", "-", part) for part in parts) or "defaults"
    if len(name) <= LONGEST_NAME:
        return name
    every = " ".join(f"{key}={values[key]}" for key in keys)
    return f"{name[: LONGEST_NAME - 9]}-{hashlib.sha256(every.encode()).hexdigest()[:8]}"


def in_sweep() -> bool:
    """Whether this is a job of a sweep."""
    settings: Any = HydraConfig.get()
    return bool(settings.mode is RunMode.MULTIRUN)


def folder_of_job() -> Path:
    """The folder of the job that is running."""
    settings = HydraConfig.get()
    return Path(settings.sweep.dir) / settings.sweep.subdir


class Start(Callback):  # type: ignore[misc]
    """Hydra calls it in the process that starts a sweep, before any job."""

    def __init__(self, swept: Sequence[str] = ()) -> None:
        """swept: for the names of jobs' folders alone; `begin` puts it into the config of each job."""

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Begin.

        Raises:
            SystemExit: the sweep cannot be started. Hydra would swallow an Exception.
        """
        try:
            self.begin(config)
        except (InputError, OSError) as error:
            print(f"dore-{config.hydra.job.config_name}: {error}", file=sys.stderr)
            raise SystemExit(ExitCode.BAD_INPUT) from None

    def begin(self, config: DictConfig) -> None:
        """Name the jobs' folders after what is swept.

        Raises:
            InputError: two jobs would share a folder.
        """
        if "sweep" in config:
            path_of("sweep", config.sweep)
        overrides = _overrides(config)
        _check_jobs_differ(overrides, set(config.hydra.job.config.override_dirname.exclude_keys))
        swept = ",".join(f"'{one.get_key_element().lstrip('+~')}'" for one in overrides if one.is_sweep_override())
        with read_write(config.hydra):
            config.hydra.overrides.hydra.append(f"hydra.callbacks.sweep.swept=[{swept}]")


def run_once(cfg: DictConfig, command: Callable[[], int]) -> int:
    """Run a job that is not done yet; the exit code, of its first run where it is done.

    Raises:
        InputError: what `command` raises, or its folder is another job's.
    """
    record = folder_of_job() / JOB_FILE
    mine = sorted(one for one in HydraConfig.get().overrides.task if not one.startswith("sweep="))
    if done := read_record(record):
        if done["overrides"] != mine:
            other = " ".join(done["overrides"])
            raise InputError(f"hydra.sweep.subdir: {record.parent} is the folder of {other}, want different names")
        print(f"{record.parent}: done before", flush=True)
        return int(done["code"])
    try:
        code = command()
    except BaseException:
        with suppress(OSError):
            record.parent.rmdir()  # Hydra made it; a job that could not start has left it empty.
        raise
    if code != ExitCode.STOPPED:
        write_record(record, {"overrides": mine, "code": int(code)})
    return code


def _overrides(config: DictConfig) -> list[Override]:
    """What the command line gives, and the sweeper's own parameters."""
    given = [f"{key}={value}" for key, value in (config.hydra.sweeper.get("params") or {}).items()]
    found: list[Override] = OverridesParser.create().parse_overrides([*given, *config.hydra.overrides.task])
    return found


def _check_jobs_differ(overrides: Sequence[Override], unnamed: set[str]) -> None:
    """A job's folder is named after its overrides, so no two jobs may have the same.

    Raises:
        InputError: a value that is given twice, or several values of a key that is in no job's name.
    """
    for override in overrides:
        if not override.is_discrete_sweep() or override.value_type is ValueType.GLOB_CHOICE_SWEEP:
            continue
        key, values = override.get_key_element(), list(override.sweep_string_iterator())
        for value in values:
            if values.count(value) > 1:
                raise InputError(f"{key}: {value} is given twice, but no two jobs may share a folder")
        if key in unnamed and len(values) > 1:
            raise InputError(f"{key}: got {', '.join(values)}, want one: no job's folder is named after it")


# When the module is loaded, so that the worker processes of a launcher have it too.
OmegaConf.register_new_resolver("job_name", job_name, replace=True)
