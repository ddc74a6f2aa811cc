"""The scene that `scene` and `instance` name: of a file, a list, a folder, or a row of an evaluation."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from omegaconf import DictConfig

from dore.app import build, run_folder
from dore.configure import make
from dore.errors import InputError, path_of, whole
from dore.files import CONFIG_FILE, ROWS_FILE, shipped_or
from dore.world.layout import Layout
from dore.world.problem import Scene
from dore.world.scene_files import read_scenes


class Given(NamedTuple):
    """A scene, and the config of the evaluation that it is a row of, if it is one."""

    scene: Scene
    evaluation: DictConfig | None


def given(cfg: DictConfig) -> Given:
    """The scene that `cfg` names; not for scene=random.

    Raises:
        InputError: no such scene, or several and no `instance`.
    """
    path = shipped_or(path_of("scene", cfg.scene), "scenes")
    if (path / CONFIG_FILE).exists():
        return _of_row(path, cfg.instance)
    scenes = read_scenes(path)
    if cfg.instance is None and len(scenes) > 1:
        raise InputError(f"instance: not given, want 1 to {len(scenes)}: {path} holds so many scenes")
    number = 1 if cfg.instance is None else whole("instance", cfg.instance, 1, at_most=len(scenes))
    return Given(scenes[number - 1], None)


def check_random(cfg: DictConfig) -> None:
    """Raise InputError where a random scene is to be an instance of something."""
    if cfg.instance is not None:
        raise InputError(f"instance: got {cfg.instance}, want none with scene=random, whose scenes differ by seed=")


def _of_row(folder: Path, instance: object) -> Given:
    """The scene of an evaluation's rows."""
    from dore.report.evaluation import PARTIAL  # pandas, which no other scene needs.
    from dore.report.rows import read_rows

    file = next((folder / name for name in (ROWS_FILE, PARTIAL) if (folder / name).exists()), None)
    if file is None:
        raise InputError(f"scene: {folder} has no {ROWS_FILE}, want a scene file or the folder of an evaluation")
    config, rows = run_folder.read_config(folder, expected=build.WORLD), read_rows(file)
    number = whole("instance", instance, 1)
    row = rows[rows.instance == number]
    if row.empty:
        raise InputError(f"instance: got {number}, and {file} has {rows.instance.min()} to {rows.instance.max()}")
    if not row.target.iloc[0]:
        raise InputError(f"{file}: does not say where its obstacles stand, as version 0.1 wrote it")
    if (benchmark := build.benchmark_of(config)) is not None:
        # Its rows are of several layouts and reaches.
        names = [name for name, one in benchmark.parts["layout"].items() if str(one) == row.layout.iloc[0]]
        parts = config.instances.parts
        config.layout, config.reach = parts.layout[names[0]], {**parts.reach[row.reach.iloc[0]], "_partial_": False}
    layout: Layout = make(config.layout, "layout")
    obstacles = tuple(int(cell) - 1 for cell in row.obstacles.iloc[0].split())
    return Given(Scene(layout, obstacles, int(row.target.iloc[0]) - 1), config)
