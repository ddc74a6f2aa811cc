"""The commands: a config is composed, the command's module runs it, and its exit code ends the process."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path

import hydra
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import InterpolationKeyError, OmegaConfBaseException
from yaml import YAMLError

from dore.app import first_checks, jobs, own_parts, renamed, sweep, sweep_job, usage
from dore.errors import ExitCode, InputError
from dore.files import conf_dir
from dore.schema import nearest

EXTRAS = {"hydra/sweeper/optuna": "optuna", "hydra/launcher/submitit": "slurm", "hydra/launcher/ray": "ray"}
"""Hydra's plugins that come with an extra of the package."""
NO_NAME = re.compile(r"|null|true|false|nan|[-+]?inf|[-+]?\d+(\.\d*)?(e[-+]?\d+)?", re.IGNORECASE)
"""What Hydra reads as a number, a truth value or nothing, and not as a name."""
SIMULATOR = ("mani_skill", "sapien", "pinocchio", "coal", "gymnasium", "imageio", "PIL")
"""Modules that come with the extra `sim`."""


def _main(name: str) -> None:
    """Compose the config, run the command, exit with its code; a user error is one line and exit code 2."""
    if answer := usage.answer(name, sys.argv[1:]):
        print(answer)
        sys.exit(ExitCode.OK)
    os.environ["HYDRA_FULL_ERROR"] = "1"  # Hydra then raises what it would print with a traceback.

    codes: list[int] = []

    def run(cfg: DictConfig) -> float | None:
        if name == "train" and jobs.in_sweep():
            return sweep_job.run_job(cfg)
        # A sweep continues after a job that failed, and ends with the worst code; one that was stopped is over.
        if ExitCode.STOPPED not in codes:
            command = partial(_run_command, name, cfg)
            codes.append(_guarded(name, partial(jobs.run_once, cfg, command) if jobs.in_sweep() else command))
        return None

    own_parts.current_folder_importable()
    own_parts.files_without_package()
    if _guarded(name, lambda: _check_groups(sys.argv[1:])) != ExitCode.OK:
        sys.exit(ExitCode.BAD_INPUT)
    command = hydra.main(version_base="1.3", config_path=str(conf_dir()), config_name=name)(run)
    try:
        composed = _guarded(name, lambda: command() or 0)
    except Exception as error:
        # A sweeper that finds no job to choose from, or a launcher whose workers are gone; the jobs are reported first.
        code = sweep.conclude()
        if code is None:
            raise
        print(f"dore-{name}: {_why_the_launcher_ended(error)}", file=sys.stderr)
        sys.exit(max(code, ExitCode.FAILED))
    sys.exit(max([composed, *codes, sweep.conclude() or 0]))


def _why_the_launcher_ended(error: Exception) -> str:
    """An error of a sweeper or a launcher, in a line; joblib reports any signal as a segmentation fault."""
    if type(error).__name__ == "TerminatedWorkerError":
        return "a process of the launcher was ended from outside, by a signal or for its memory"
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def _check_groups(overrides: list[str]) -> int:
    """Refuse a value that cannot be an option's name where a group wants one: Hydra would fail with an assertion."""
    for override in overrides:
        key, given, value = override.lstrip("+").partition("=")
        folders = own_parts.group_folders(key.partition("@")[0], overrides)
        if given and not override.startswith("-") and folders and NO_NAME.fullmatch(value):
            raise InputError(_no_option(key, value or "nothing", folders))
    return ExitCode.OK


def _no_option(group: str, value: str, folders: Sequence[Path]) -> str:
    options = ", ".join(sorted({path.stem for folder in folders for path in folder.glob("*.yaml")}))
    return f"{group}: got {value}, want one of its options: {options}"


def _run_command(name: str, cfg: DictConfig) -> int:
    """`NAME_command` of dore.app.NAME; imported only after the config is composed, so that --help answers at once."""
    own_parts.prepare(cfg)
    first_checks.check(name, cfg)
    try:
        code: int = getattr(import_module(f"dore.app.{name}"), f"{name}_command")(cfg)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] not in SIMULATOR:
            raise
        missing = f"needs the simulator, and {error.name} is not installed"
        raise InputError(f"{missing}; in the checkout of dore: pip install '.[sim]'") from None
    return code


def _guarded(name: str, work: Callable[[], int]) -> int:
    """The exit code of `work`; bad input, a bad config and a disk error end with one line."""
    try:
        return work()
    except InputError as error:
        message = str(error)
    except InterpolationKeyError as error:
        message = _no_source(str(error))
    except (HydraException, OmegaConfBaseException) as error:
        message = _config_message(name, str(error))
    except YAMLError as error:  # Of an option's file; it says where.
        message = str(error)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        print(f"dore-{name}: stopped", file=sys.stderr)
        return ExitCode.STOPPED
    except OSError as error:
        message = f"{error.filename or 'disk'}: {error.strerror or error}"
    print(f"dore-{name}: {' '.join(message.split())}", file=sys.stderr)
    return ExitCode.BAD_INPUT


def _no_source(text: str) -> str:
    """OmegaConf's error about a value that is taken from a key which is not there, in a line."""
    key, source = re.search(r"full_key: (\S+)", text), re.search(r"Interpolation key '([^']+)'", text)
    if key is None or source is None:
        return text
    return f"{key[1]}: not given, and there is no {source[1]} to take it from; want {key[1]}=VALUE"


def _config_message(command: str, text: str) -> str:
    """Hydra's error, with the options there are and without its advice on Hydra itself."""
    text = text.split("Config search path")[0]
    for plugin, extra in EXTRAS.items():
        if f"'{plugin}" in text:
            return f"{plugin}: not installed, want the extra `{extra}` (docs/sweeps.md)"
    today = renamed.hint(text)
    if today:
        return today
    if option := re.search(r"Could not load '(.+)/([^']+)'", text):  # One of several; of one alone Hydra lists them.
        return _no_option(option[1], option[2], own_parts.group_folders(option[1], sys.argv[1:]))
    unknown = re.search(r"Could not override '([^']+)'", text)
    if not unknown:
        return text
    key = unknown[1]
    parent, _, last = key.rpartition(".")
    # Only choices of groups, which shape the config; another key may be wrong as well.
    own = own_parts.given(sys.argv[1:])
    groups = [
        one
        for one in sys.argv[1:]
        if own_parts.group_folders(one.partition("=")[0], sys.argv[1:]) and re.search(r"=(\[.*\]|[^,]*)$", one)
    ]
    try:
        with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
            composed = hydra.compose(command, [*groups, *own])
    except (HydraException, OmegaConfBaseException):  # The key is itself a group, of another command.
        return f"{key}: dore-{command} has no such key"
    node = OmegaConf.select(composed, parent) if parent else composed
    if not isinstance(node, DictConfig):
        parent, last, node = "", parent, composed
    options = [str(name) for name in node if not str(name).startswith("_")]
    return f"{key}: no such key{nearest(last, options)}; {parent or command} has: {', '.join(options)}"


# The programs of pyproject.toml.
train = partial(_main, "train")
evaluate = partial(_main, "evaluate")
plan = partial(_main, "plan")
execute = partial(_main, "execute")
report = partial(_main, "report")


def dore() -> None:
    """`dore COMMAND ...`, which is dore-COMMAND; also `python -m dore`."""
    command, *rest = sys.argv[1:] or ["--help"]
    if command in usage.COMMANDS:
        sys.argv = [f"dore-{command}", *rest]
        _main(command)
    elif command in ("--help", "-h"):
        print(usage.overview())
    elif command == "--version":
        print(usage.version())
    else:
        known = ", ".join(usage.COMMANDS)
        print(f"dore: {command}: no such command{nearest(command, usage.COMMANDS)}; want {known}", file=sys.stderr)
        sys.exit(ExitCode.BAD_INPUT)
