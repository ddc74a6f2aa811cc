"""The runs behind Table 4: what scripts/table4.sh has trained and tested, read from its folders."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omegaconf import DictConfig

from dore.app.run_folder import DONE, read_config
from dore.errors import InputError
from dore.report.evaluation import ROWS, Row, read_rows
from scripts.learning_curves import Ipt, read_tests

COLUMNS = ("6x6_z3-5", "6x6_z3-8", "7x7_z3-5", "7x7_z3-10", "8x8_z3-5", "8x8_z3-13")
PAPER = {
    "single": dict(zip(COLUMNS, (95, 78, 95, 64, 95, 53), strict=True)),
    "sequential": dict(zip(COLUMNS, (95, 95, 95, 81, 95, 78), strict=True)),
}
"""Table 4 as printed: success rates, %."""
SAME = ("min_obstacles", "max_obstacles", "test_size", "seed")
"""What of `instances` decides which ones are tested."""


@dataclass(frozen=True)
class Trained:
    """A training run that has ended: done.json, config, and its IPTs."""

    done: dict[str, Any]
    cfg: DictConfig
    tests: list[Ipt]


@dataclass(frozen=True)
class Runs:
    """All that the table is made from. A run that is not there, or has not ended, is left out.

    literal, improved: trained runs by name (single, sequential; seed0, seed1, ...) and column.
    sooner: improved ones that the paper's own test has ended.
    rows: the tests' rows by column and name, `exact` and `generalist` among the names.
    worlds: the config of each column's `exact`. commits, torch: of all runs.
    """

    literal: dict[tuple[str, str], Trained]
    improved: dict[tuple[str, str], Trained]
    sooner: dict[tuple[str, str], Trained]
    rows: dict[str, dict[str, list[Row]]]
    worlds: dict[str, DictConfig]
    commits: list[str]
    torch: list[str]

    @property
    def columns(self) -> list[str]:
        """The columns that were tested, in the paper's order."""
        return [column for column in COLUMNS if column in self.rows]


def read_runs(folder: Path) -> Runs:
    """Read `folder`/literal, /improved, /sooner and /test.

    Raises:
        InputError: no column was tested, tests of one column that saw different instances, or a damaged file.
    """
    rows: dict[str, dict[str, list[Row]]] = {}
    worlds: dict[str, DictConfig] = {}
    for column in COLUMNS:
        tests = {path.parent.name: path.parent for path in sorted(folder.glob(f"test/{column}/*/{ROWS}"))}
        if "exact" not in tests:
            continue
        worlds[column] = read_config(tests["exact"])
        for test in tests.values():
            _check_same_instances(tests["exact"], test)
        rows[column] = {name: read_rows(test / ROWS) for name, test in tests.items()}
    if not rows:
        raise InputError(f"{folder}: no column is tested, want one or more with the proved optimum (test/COLUMN/exact)")
    abouts = [read_json(path) for path in sorted(folder.glob("**/about.json"))]
    return Runs(
        literal=_trained(folder / "literal"),
        improved=_trained(folder / "improved"),
        sooner=_trained(folder / "sooner"),
        rows=rows,
        worlds=worlds,
        commits=sorted({str(about["commit"]) for about in abouts}),
        torch=sorted({about["versions"]["torch"] for about in abouts}),
    )


def _trained(folder: Path) -> dict[tuple[str, str], Trained]:
    """The runs that have ended, by what their folders' names say."""
    found = {}
    for done in sorted(folder.glob(f"*/{DONE}")):
        name = re.fullmatch(r"(.+?)_(\d+x\d+_z\d+-\d+)", done.parent.name)
        if name is None:
            raise InputError(f"{done.parent}: want a folder called NAME_COLUMN, as single_6x6_z3-5")
        found[name[1], name[2]] = Trained(read_json(done), read_config(done.parent), read_tests(done.parent))
    return found


def _check_same_instances(first: Path, second: Path) -> None:
    one, other = (
        read_config(path, expected=("layout", "reach", "instances", "split", "limit")) for path in (first, second)
    )
    differ = [key for key in ("layout", "reach", "split", "limit") if one[key] != other[key]]
    differ += [f"instances.{key}" for key in SAME if one.instances[key] != other.instances[key]]
    if differ:
        raise InputError(f"{second}: {', '.join(differ)} not as in {first}, want the same instances")


def read_json(path: Path) -> dict[str, Any]:
    """A JSON file of a run.

    Raises:
        InputError: it is damaged.
    """
    try:
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise InputError(f"{path}: damaged ({error})") from None
    return found
