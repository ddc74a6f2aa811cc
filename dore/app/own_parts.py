"""A user's own parts: folders of configs (--config-dir, hydra.searchpath) and modules, and how they must be given."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path

from hydra._internal.core_plugins import file_config_source
from hydra._internal.sources_registry import SourcesRegistry
from hydra._internal.utils import get_args_parser
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.plugins import Plugins
from hydra.plugins.config_source import ConfigResult
from omegaconf import DictConfig, open_dict

from dore.configure import trust_command_line
from dore.errors import InputError
from dore.files import conf_dir

OWN_PROVIDERS = ("command-line", "hydra.searchpath")
PACKAGES = {"planner": "planners.NAME", "logger": "loggers.NAME", "experiment": "_global_", "column": "_global_"}
"""Groups whose keys do not go below the group's own name, and where those of a file without `# @package` go."""


class FileConfigSource(file_config_source.FileConfigSource):
    """Config files; one that does not say where its keys go is read as if it said what its group wants.

    Named as Hydra's own: in the workers of a launcher Hydra registers that one again, and refuses another name.
    """

    def load_config(self, config_path: str) -> ConfigResult:
        """The file's keys, with a package."""
        result = super().load_config(config_path)
        group, _, option = config_path.removesuffix(".yaml").rpartition("/")
        if group in PACKAGES and result.header.get("package") is None:
            result.header["package"] = PACKAGES[group].replace("NAME", option)
        return result


def files_without_package() -> None:
    """Let Hydra read config files as `FileConfigSource` of this module does."""
    Plugins.instance()  # Registers Hydra's own sources, once.
    SourcesRegistry.instance().types["file"] = FileConfigSource


def current_folder_importable() -> None:
    """Let configs name the classes of modules in the current folder; what is installed comes first."""
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())


def given(arguments: Sequence[str]) -> list[str]:
    """The overrides by which other compositions find the own folders that a command line names."""
    parsed, _ = get_args_parser().parse_known_args(list(arguments))
    overrides: list[str] = list(parsed.overrides)
    searched = next((one for one in overrides if one.partition("=")[0] == "hydra.searchpath"), None)
    entries = [] if searched is None else [searched.partition("=")[2].strip("[]")]
    if parsed.config_dir:
        entries.insert(0, _quoted(f"file://{os.path.abspath(parsed.config_dir)}"))
    return [f"hydra.searchpath=[{','.join(filter(None, entries))}]"] if entries else []


def of_job() -> list[str]:
    """The overrides by which a sweep's job finds the folders that its sweep was started with."""
    own = ",".join(map(_quoted, _own_sources()))
    return [f"hydra.searchpath=[{own}]"] if own else []


def group_folders(group: str, arguments: Sequence[str]) -> list[Path]:
    """Where the options of a group are: in the package, and in a folder that --config-dir names."""
    parsed, _ = get_args_parser().parse_known_args(list(arguments))
    roots = [conf_dir(), *([Path(parsed.config_dir)] if parsed.config_dir else [])]
    return [root / group for root in roots if group and (root / group).is_dir()]


def prepare(cfg: DictConfig) -> None:
    """Make a composed config's own parts usable.

    Raises:
        InputError: one that cannot be used.
    """
    current_folder_importable()  # In a launcher's worker, too.
    _check_files(cfg)
    trust_command_line(cfg)
    if isinstance(cfg.get("layout"), DictConfig):
        with open_dict(cfg):
            cells_stay(cfg.layout)


def cells_stay(layout: DictConfig) -> None:
    """Cells given by their centres stay there: an arm's preset moves the front edge of rectangular layouts only.

    Raises:
        InputError: the command line gives both.
    """
    if "cells" in layout and "front_m" in layout:
        if any(one.lstrip("+").startswith("layout.front_m=") for one in HydraConfig.get().overrides.task):
            raise InputError(f"layout.front_m: got {layout.front_m}, want none: layout.cells say where the cells are")
        del layout["front_m"]


def _check_files(cfg: DictConfig) -> None:
    """Refuse what would otherwise be ignored silently.

    Raises:
        InputError: an own file of a name that the package has too, or a planner whose keys go where nothing reads them.
    """
    for root in (Path(url.removeprefix("file://")) for url in _own_sources()):
        for path in sorted(root.rglob("*.yaml")):
            shipped = conf_dir() / path.relative_to(root)
            if shipped.is_file() and shipped.read_bytes() != path.read_bytes():
                option = path.relative_to(root).with_suffix("")
                raise InputError(f"{path}: the package has {option} too, which comes first; want another name")
    chosen = [one for one in HydraConfig.get().overrides.task if one.startswith("planner=")]
    value = OverridesParser.create().parse_override(chosen[-1]).value() if chosen else []
    named = [str(one) for one in value] if isinstance(value, list) else [str(value)]
    there = list(cfg.get("planners", {}))
    if len(there) < len(named):
        wanted = "want files whose first line is # @package planners.NAME, each its own NAME, or that have no such line"
        raise InputError(f"planner: got {', '.join(named)}, of which {len(there)} can be used; {wanted}")


def _own_sources() -> list[str]:
    """The own folders that this config was composed from, as Hydra's search path names them."""
    own = [one for one in HydraConfig.get().runtime.config_sources if one.provider.startswith(OWN_PROVIDERS)]
    return [f"{one.schema}://{os.path.abspath(one.path) if one.schema == 'file' else one.path}" for one in own]


def _quoted(url: str) -> str:
    return "'" + url.replace("'", "\\'") + "'"
