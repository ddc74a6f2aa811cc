"""Scenes of one's own: one file, a list in a file, or a folder of scene files; and as a test set."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from dore.errors import InputError, path_of
from dore.schema import named, read_json
from dore.world.files import read_scene, scene_of
from dore.world.layout import Layout
from dore.world.problem import Batch, Problem, Scene
from dore.world.reach import Reach

if TYPE_CHECKING:
    from dore.world.generator import InstanceSource
    from dore.world.instances import InstanceSet


def read_scenes(path: str | os.PathLike[str]) -> list[Scene]:
    """The scenes of a file that holds one or a list of them, or of a folder's *.json files in the order of their names.

    Raises:
        InputError: no such file, none in it, or one that is wrong; names the file, and its number in a list.
    """
    path = Path(path)
    if path.is_dir():
        files = sorted(path.glob("*.json"))
        if not files:
            raise InputError(f"{path}: no *.json in this folder, want scene files")
        return [read_scene(file) for file in files]
    with named(path):
        data = read_json(path)
        if not isinstance(data, list):
            return [scene_of(data)]
        if not data:
            raise InputError("an empty list, want scenes")
        scenes = []
        for number, one in enumerate(data, 1):
            with named(f"scene {number}"):
                scenes.append(scene_of(one))
        return scenes


@dataclass(frozen=True)
class SceneInstances:
    """Scenes of one's own, to evaluate on; both splits are all of them, in their order.

    Args:
        path: see `read_scenes`.

    Raises:
        InputError: a scene that is wrong, or has another layout than the first one.
    """

    path: str

    def __post_init__(self) -> None:
        self.check_layout(self.layout)

    @cached_property
    def scenes(self) -> list[Scene]:
        """All of them."""
        return read_scenes(path_of("instances.path", self.path))

    @property
    def layout(self) -> Layout:
        """That of the first scene."""
        return self.scenes[0].layout

    def check_layout(self, layout: Layout) -> None:
        """Raise InputError for a scene that has another layout."""
        for number, scene in enumerate(self.scenes, 1):
            if not scene.layout.coincides(layout):
                raise InputError(f"instances: scene {number} has {scene.layout}, want one layout of all, as {layout}")

    def most_obstacles(self, n_cells: int) -> int:
        """The most that a scene has."""
        return max(len(scene.obstacles) for scene in self.scenes)

    def train(self, reach: Reach, seed: int) -> InstanceSource:
        """Nothing to train on.

        Raises:
            InputError: always.
        """
        raise InputError("instances: scenes of one's own are for evaluations, want z3-7 or another to train on")

    def test(self, reach: Reach) -> InstanceSet:
        """All scenes; those whose target is accessible at the start are among them."""
        import torch

        from dore.world.instances import InstanceSet

        self.check_layout(reach.layout)
        boards, targets = zip(*(Batch.of(Problem(scene, reach)) for scene in self.scenes), strict=True)
        return InstanceSet(reach, torch.cat(boards), torch.cat(targets), accessible=True)

    validation = test
