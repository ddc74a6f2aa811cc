"""Run folders as the commands leave them, made by hand, and what a study makes of them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import hydra
import pandas as pd
import yaml
from hydra.core.global_hydra import GlobalHydra
from omegaconf import OmegaConf

from dore.files import conf_dir
from dore.report.facts import facts_of
from dore.report.rows import Row, Timing, write_rows
from dore.report.sources import sources_of
from dore.report.study import cells_of
from dore.world.plan import Status

NO_PLAN = 0
ABOUT = {"commit": "abc1234", "versions": {"torch": "2.0"}}


def study(name: str) -> dict[str, Any]:
    """A study of conf/study."""
    GlobalHydra.instance().clear()
    with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
        cfg = hydra.compose("report", [f"study={name}"])
    found: dict[str, Any] = OmegaConf.to_container(cfg.study, resolve=True)  # type: ignore[assignment]
    return found


def rows_of(planner: str, *moves: int | None, seconds: Sequence[float] = (), text: str = "", z: int = 3) -> list[Row]:
    """One row per instance: its moves, None for a planner that gave up, NO_PLAN for a proof that there is no plan.

    text: the reason in every row; without one a row that is not solved has hit the move budget.
    """
    status = {None: Status.GAVE_UP, NO_PLAN: Status.UNSOLVABLE}
    seconds = seconds or (0.5,) * len(moves)
    return [
        Row(
            planner,
            n,
            36,
            z,
            status.get(m, Status.SOLVED),
            text or ("" if m else "move budget"),
            m or 0,
            seconds[n - 1],
            0,
            Timing.SINGLE,
        )
        for n, m in enumerate(moves, 1)
    ]


def evaluation(folder: Path, rows: Sequence[Row], **config: Any) -> None:
    """An evaluation that is done."""
    folder.mkdir(parents=True)
    write_rows(folder / "rows.csv", rows)
    _about(folder, {"reach": {"clearance_m": 0.142}, "split": "test", "instances": {"seed": 0}} | config)


def training(folder: Path, *tests: Sequence[float], done: Mapping[str, Any] | None = None, **config: Any) -> None:
    """A training that has ended; a test is episodes, seconds, success, updates, rearrangements."""
    folder.mkdir(parents=True)
    lines = ["episodes,seconds,success,updates,rearrangements", *(",".join(map(str, one)) for one in tests)]
    (folder / "metrics.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    end = {"stop_reason": "budget", "episodes": 900, "updates": 7, "seconds": 120.0, "best_success": 0.97}
    (folder / "done.json").write_text(json.dumps(end | dict(done or {})), encoding="utf-8")
    _about(folder, {"seed": 0, "training": {"max_episodes": 1800, "max_minutes": 1}} | config)


def _about(folder: Path, config: Mapping[str, Any]) -> None:
    (folder / "config.yaml").write_text(yaml.safe_dump(dict(config)), encoding="utf-8")
    (folder / "about.json").write_text(json.dumps(ABOUT), encoding="utf-8")


def cell(cells: pd.DataFrame, metric: str, row: str, column: str) -> pd.Series:
    """The one cell of that name."""
    found = cells[(cells.metric == metric) & (cells["row"] == row) & (cells.column == column)]
    assert len(found) == 1, f"{metric}, {row}, {column}: {len(found)} cells"
    return found.iloc[0]


def made(name: str, root: Path) -> tuple[pd.DataFrame, dict[str, object]]:
    spec = study(name)
    sources = sources_of(spec, root, root)
    return cells_of(spec, sources), facts_of(spec, sources)
