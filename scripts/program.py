"""What the measuring programs share: options as KEY=VALUE words, bad input as one line, configs and planners."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar, cast

import hydra
import torch
import yaml
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from dore.errors import ExitCode, InputError, seed_of, whole
from dore.files import conf_dir

Options = TypeVar("Options")


def run(main: Callable[[Options], int | None], options: type[Options], words: Sequence[str] | None = None) -> int:
    """Run a program on one torch thread; its exit code, 0 where it returns none.

    Args:
        options: a dataclass; it checks its values when it is made.
        words: KEY=VALUE each, a list as [a,b]; those of the command line unless given.
    """
    words = sys.argv[1:] if words is None else words
    path = Path(inspect.getfile(main))
    torch.set_num_threads(1)
    if "--help" in words:
        defaults = OmegaConf.to_yaml(OmegaConf.structured(options))
        print(f"{inspect.getdoc(inspect.getmodule(main))}\n\nOptions, KEY=VALUE:\n{defaults}")
        return ExitCode.OK
    try:
        return main(options_of(options, words)) or ExitCode.OK
    except (InputError, HydraException) as error:
        print(f"{path.stem}: {' '.join(str(error).split())}", file=sys.stderr)
        return ExitCode.BAD_INPUT
    except KeyboardInterrupt:
        return ExitCode.STOPPED


def options_of(options: type[Options], words: Sequence[str]) -> Options:
    """The options that the words give, and the defaults of the others.

    A whole number is a count of 1 or more, or one for each in a list; the option `seed` is a seed.

    Raises:
        InputError: no such option, a value of another type, or one that the options refuse.
    """
    try:
        given = OmegaConf.merge(OmegaConf.structured(options), OmegaConf.from_dotlist(list(words)))
        found = cast(Options, OmegaConf.to_object(given))
    except (OmegaConfBaseException, yaml.YAMLError) as error:
        key = getattr(error, "full_key", None) or " ".join(words)
        names = ", ".join(one.name for one in fields(cast(Any, options)))
        raise InputError(f"{key}: {str(error).splitlines()[0]}; the options are {names}") from None
    for name, value in vars(found).items():
        for one in value if isinstance(value, list) else [value]:
            if isinstance(one, int) and not isinstance(one, bool):
                seed_of(name, one) if name == "seed" else whole(name, one, 1)
    return found


def composed(command: str, *overrides: str) -> DictConfig:
    """The config of a command, as dore-evaluate's."""
    with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
        return hydra.compose(command, list(overrides))
