"""What dore-report does with a composed config."""

from __future__ import annotations

from typing import Any, cast

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from dore.errors import ExitCode, flag, path_of, whole
from dore.files import locked
from dore.report import results, runs


def report_command(cfg: DictConfig) -> int:
    """Make a study's missing runs where that is asked for, then its page; the exit code.

    Raises:
        InputError: a study, a folder or a file that does not fit.
    """
    node: DictConfig = cfg.study
    spec = cast(dict[str, Any], OmegaConf.to_container(node, resolve=True))
    name = str(HydraConfig.get().runtime.choices["study"])
    folder = None if cfg.folder is None else path_of("folder", cfg.folder)
    code = 0
    if flag("run", cfg.run):
        if folder is None:
            folder = path_of("study.folder", spec.get("folder", f"outputs/{name}"))
        folder.mkdir(parents=True, exist_ok=True)
        with locked(folder, "folder"):
            code = runs.make_missing(spec, folder, whole("jobs", cfg.jobs, 1, at_most=256))
        if code == ExitCode.STOPPED:
            print(f"stopped; resume with: dore-report study={name} run=true")
            return code
    pages = path_of("results", cfg.results)
    pages.mkdir(parents=True, exist_ok=True)
    with locked(pages, "results"):
        print(results.write_page(spec, name, folder, pages))
    return code
