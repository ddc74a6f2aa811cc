"""The benchmark: boards of known optimum, in strata by optimum, density, layout and reach, kept in one file.

G denotes the cells of a layout, N the instances of one of its settings.
"""

from __future__ import annotations

import hashlib
import os
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np
import torch

from dore.errors import InputError, path_of, seed_of, shown, whole
from dore.world.board import pack
from dore.world.instances import InstanceSet
from dore.world.reach import Reach

STRATA = ("1", "2", "3", "4", "5-6", "7+", "unsolvable")
"""By the proved fewest moves."""
UNSOLVABLE = 255
"""What stands in the file for the optimum of an instance that is proved to have no plan."""
SHIPPED = Path(__file__).with_name("benchmark.npz")
"""The benchmark in the package."""


class Setting(NamedTuple):
    """What the instances of several strata have in common. density: obstacles, per cent of the cells."""

    layout: str
    reach: str
    density: int

    def __str__(self) -> str:
        return f"{self.layout} {self.reach} {self.density}"


class BenchmarkSet(NamedTuple):
    """The instances of one layout and reach. about: of each instance its reach, density, stratum and optimum."""

    layout: str
    reach: str
    instances: InstanceSet
    about: list[dict[str, Any]]


@dataclass(frozen=True)
class Benchmark:
    """Instances of the test split, all different, no two of them mirror images, in strata by the proved optimum.

    Args:
        layouts, reaches: names of those in `parts`.
        densities: obstacles, per cent of the cells; half an obstacle counts as one.
        parts: `layout`: layouts by name; `reach`: reaches by name, each still without a layout.
        path: of the file; None: the one in the package.
        sha256: the `digest` that the file must have; None: any.
        per_stratum, max_nodes, quick_nodes, max_candidates, seed: see `dore.world.strata`, which makes the file.

    Raises:
        InputError: a number outside its domain, or nothing to draw from.
    """

    layouts: Sequence[str]
    reaches: Sequence[str]
    densities: Sequence[int]
    parts: Mapping[str, Mapping[str, Any]]
    path: str | None
    sha256: str | None
    per_stratum: int
    max_nodes: int
    quick_nodes: int
    max_candidates: int
    seed: int

    def __post_init__(self) -> None:
        for name in ("layouts", "reaches", "densities"):
            if not getattr(self, name):
                raise InputError(f"instances.{name}: got none, want one or more")
        for key, kind in (("layouts", "layout"), ("reaches", "reach")):
            known = self.parts[kind]
            if unknown := [name for name in getattr(self, key) if name not in known]:
                raise InputError(f"instances.{key}: got {shown(unknown[0])}, want some of {', '.join(known)}")
        for density in self.densities:
            whole("instances.densities", density, 1, at_most=99)
        for name in ("per_stratum", "max_nodes", "quick_nodes", "max_candidates"):
            whole(f"instances.{name}", getattr(self, name), 1)
        seed_of("instances.seed", self.seed)

    def train(self, *_: object) -> NoReturn:
        """Nothing to train on.

        Raises:
            InputError: always.
        """
        raise InputError("instances: got benchmark, which is for evaluations, want z3-7 or another to train on")

    validation = test = train

    @property
    def settings(self) -> list[Setting]:
        """All combinations."""
        return [Setting(*one) for one in product(self.layouts, self.reaches, self.densities)]

    def reach_of(self, layout: str, reach: str, device: torch.device | str = "cpu") -> Reach:
        """The accessibility check of a layout under a reach, by their names."""
        made: Reach = self.parts["reach"][reach](layout=self.parts["layout"][layout])
        return made.to(device)

    @cached_property
    def rows(self) -> dict[str, np.ndarray]:
        """Of each setting UInt8[N, 2 + ceil(G / 8)]: the target, the optimum and the board, a bit a cell.

        Raises:
            InputError: no such file, a damaged one, another digest, or a setting that it lacks.
        """
        file = SHIPPED if self.path is None else path_of("instances.path", self.path)
        found = read(file)
        if self.sha256 is not None and (got := digest(found)) != self.sha256:
            raise InputError(f"instances.sha256: got {got} of {file}, want {self.sha256}")
        if lacking := [str(setting) for setting in self.settings if str(setting) not in found]:
            raise InputError(f"instances.path: {file} has no boards of {lacking[0]}, want those of all settings")
        return {str(setting): found[str(setting)] for setting in self.settings}

    def sets(self, limit: int | None, device: torch.device | str) -> list[BenchmarkSet]:
        """The instances of each layout and reach.

        limit: the most of a stratum; None: all.

        Raises:
            InputError: what `rows` raises, or a board that is none.
        """
        most = None if limit is None else whole("limit", limit, 1)
        return [self._set(*names, most, device) for names in product(self.layouts, self.reaches)]

    def _set(self, layout: str, reach: str, most: int | None, device: torch.device | str) -> BenchmarkSet:
        on = self.reach_of(layout, reach, device)
        kept, about = [], []
        for density in self.densities:
            rows = self.rows[str(Setting(layout, reach, density))]
            stratum = stratum_of(rows[:, 1])
            for number, name in enumerate(STRATA):
                part = rows[stratum == number][:most]
                kept.append(part)
                optima = (None if name == "unsolvable" else optimum for optimum in part[:, 1].tolist())
                about += [{"reach": reach, "density": density, "stratum": name, "optimum": one} for one in optima]
        board, target = unpacked(np.concatenate(kept), on)
        return BenchmarkSet(layout, reach, InstanceSet(on, board, target), about)


def stratum_of(optimum: np.ndarray) -> np.ndarray:
    """The place in STRATA of each of UInt8[N] optima."""
    return np.where(optimum == UNSOLVABLE, 6, np.searchsorted([2, 3, 4, 5, 7], optimum, side="right"))


def unpacked(rows: np.ndarray, reach: Reach) -> tuple[torch.Tensor, torch.Tensor]:
    """Boards Int64[N, W] and targets Int64[N] of a file's rows.

    Raises:
        InputError: rows of a layout of another size.
    """
    n_cells = reach.n_cells
    if rows.shape[1] != 2 + -(-n_cells // 8):
        raise InputError(f"instances.path: rows of {rows.shape[1]} bytes, want those of {n_cells} cells")
    occupied = np.unpackbits(rows[:, 2:], axis=1, count=n_cells, bitorder="little").astype(bool)
    return pack(torch.from_numpy(occupied)), torch.from_numpy(rows[:, 0].astype(np.int64))


def digest(settings: Mapping[str, np.ndarray]) -> str:
    """SHA-256 of the names, the shapes and the bytes of all settings, in the order of their names."""
    found = hashlib.sha256()
    for name in sorted(settings):
        found.update(f"{name} {settings[name].shape} ".encode() + np.ascontiguousarray(settings[name]).tobytes())
    return found.hexdigest()


def read(path: str | os.PathLike[str]) -> dict[str, np.ndarray]:
    """The settings of a file.

    Raises:
        InputError: no such file, or a damaged one.
    """
    try:
        with np.load(path) as file:
            found = {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: damaged ({' '.join(str(error).split())})") from None
    for name, rows in found.items():
        if rows.dtype != np.uint8 or rows.ndim != 2:
            raise InputError(f"{path}: {name}: got {rows.dtype} {shown(rows.shape)}, want bytes [N, 2 + cells / 8]")
    return found
