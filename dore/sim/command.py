"""What dore-execute does with a composed config; returns the exit code."""

from __future__ import annotations

from pathlib import Path

from omegaconf import DictConfig

from dore import build, run_folder
from dore.errors import InputError, path_of, seed_of
from dore.plan_files import read_plan
from dore.sim.execute import REPORT_NAME
from dore.sim.execute import execute as execute_plan
from dore.sim.report import ExecutionReport

OK, FAULT, REFUSED = 0, 1, 3


def execute(cfg: DictConfig) -> int:
    """Carry out a plan file. 0: done; 1: a fault was seen on the way; 3: refused before anything moved."""
    if cfg.video not in ("auto", "off"):
        raise InputError(f"video: got {cfg.video!r}, want auto or off")
    seed_of("seed", cfg.seed)
    plan_file = read_plan(path_of("plan", cfg.plan))
    arm, camera, objects = (build.make(cfg[name], name) for name in ("arm", "camera", "objects"))
    with run_folder.claimed(cfg.run_dir, worth=REPORT_NAME) as folder:
        report = execute_plan(
            plan_file, arm, folder, cfg.video == "auto", objects=objects, camera=camera, seed=cfg.seed
        )
    _print_report(report, folder)
    if report.refused:
        return REFUSED
    return OK if report.success else FAULT


def _print_report(report: ExecutionReport, folder: Path) -> None:
    for move in report.moves:
        error = "" if move.placement_error_mm is None else f"placed within {move.placement_error_mm:.1f} mm, "
        print(
            f"  {move.name}: {move.outcome}, {error}others moved {move.others_moved_mm:.1f} mm at most, "
            f"{move.simulated_s:.1f} simulated s"
        )
    print(report.message)
    if report.pictures != report.video:
        print(report.pictures)
    made = [REPORT_NAME, *([report.video] if report.video else [])]
    print(f"{' and '.join(made)} {'is' if len(made) == 1 else 'are'} in {folder}")
