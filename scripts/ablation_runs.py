"""The runs of scripts/ablation.sh: one key changed in each, read from their folders."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omegaconf import DictConfig

from dore.app.run_folder import DONE, LEARNING, leaves, read_config
from dore.errors import InputError
from scripts.learning_curves import Ipt, read_tests

NONE = "none"
"""The change that is none: what the others are set against."""
BASES, STRUCTURES = ("improved", "literal"), ("sequential", "single")


@dataclass(frozen=True)
class Variant:
    """A change, and its runs, one a seed. changed: the keys that it sets otherwise than its base, `key: was -> is`."""

    base: str
    structure: str
    change: str
    configs: list[DictConfig]
    abouts: list[dict[str, Any]]
    tests: list[list[Ipt]]
    changed: list[str]


def read_variants(folder: Path) -> list[Variant]:
    """Those with a run that has ended, base by base.

    Raises:
        InputError: there are none, or none without a change to set them against.
    """
    found: dict[tuple[str, str, str], list[Path]] = {}
    for done in sorted(folder.glob(f"*/{DONE}")):
        name = re.fullmatch(r"(improved|literal)_(sequential|single)_([a-z-]+)_seed\d+", done.parent.name)
        if name is None:
            raise InputError(f"{done.parent}: want a folder called BASE_STRUCTURE_CHANGE_seedN")
        found.setdefault((name[1], name[2], name[3]), []).append(done.parent)
    if not found:
        raise InputError(f"{folder}: no run has ended, want one or more")
    order = sorted(found, key=lambda key: (BASES.index(key[0]), STRUCTURES.index(key[1]), key[2] != NONE, key[2]))
    variants = []
    for base, structure, change in order:
        runs = found[base, structure, change]
        if (base, structure, NONE) not in found:
            raise InputError(f"{runs[0]}: there is no {base}_{structure}_{NONE} to set it against")
        configs = [read_config(run) for run in runs]
        variants.append(
            Variant(
                base,
                structure,
                change,
                configs,
                [json.loads((run / "about.json").read_text(encoding="utf-8")) for run in runs],
                [read_tests(run) for run in runs],
                _changed(read_config(found[base, structure, NONE][0]), configs[0]),
            )
        )
    return variants


def _changed(was: DictConfig, now: DictConfig) -> list[str]:
    """What it learns otherwise, but for the seed."""
    first, second = dict(leaves(was)), dict(leaves(now))
    return [
        f"{key}: {first.get(key, '-')} -> {second.get(key, '-')}"
        for key in dict.fromkeys([*first, *second])
        if first.get(key) != second.get(key) and key.split(".")[0] in LEARNING and key != "seed"
    ]
