"""The page of many executions, and a CSV of them, from their reports alone.

python -m scripts.execution_report PAGE COMMAND TITLE=FOLDER...: each FOLDER is one of scripts/executions.py; PAGE.md
and PAGE.csv are written.
"""

from __future__ import annotations

import csv
import json
import os
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

from dore.files import atomic_write, commit
from dore.report.intervals import percentile, wilson
from dore.report.tables import Table, as_markdown
from dore.sim.run.setup import REPORT_NAME
from scripts.executions import ARGUMENTS

PUSHED_MM = 5.0


@dataclass(frozen=True)
class Run:
    """One execution. pushed: moves in which an object that should stand still moved more than `PUSHED_MM`. faults,
    plans: how many a closed loop noted."""

    title: str
    obstacles: int
    number: str
    disturbance: str
    outcome: str
    refused: bool
    success: bool
    claimed: bool
    toppled: bool
    moves: int
    pushed: int
    faults: int
    plans: int
    others_moved_mm: float
    placement_error_mm: float | None
    tilt_deg: float
    grasp_margin_mm: float
    simulated_s: float
    rehearsal_s: float | None
    wall_s: float
    message: str


def main(page: Path, command: str, folders: dict[str, Path]) -> None:
    """Read, count, write."""
    runs = [run for title, folder in folders.items() for run in read(title, folder)]
    with atomic_write(page.with_suffix(".csv")) as file:
        writer = csv.DictWriter(file, list(asdict(runs[0])), lineterminator="\n")
        writer.writeheader()
        writer.writerows(asdict(run) for run in runs)
    lines = [
        "# Executions on the simulated arm",
        "",
        f"`{command}`, commit {commit()}, load {os.getloadavg()[0]:.2f} when this page was made from the reports. The "
        "defaults of `dore-execute` but for what is said of each part: 3 x 6, `reach=panda_slim`, cuboids and cans in "
        "turn. Success is the simulator's own word: the target is held up and out of the grid, every other object "
        "stands upright in a cell. A wrong claim is a closed loop's that this word does not confirm.",
    ]
    for title in folders:
        mine = [run for run in runs if run.title == title]
        lines += [
            "",
            f"## {title}",
            "",
            _about(folders[title], mine),
            "",
            as_markdown(_summary(mine)),
            "",
            *_others(mine),
        ]
    with atomic_write(page.with_suffix(".md")) as file:
        file.write("\n".join(lines).rstrip("\n") + "\n")
    print(f"{page}.md")


def _about(folder: Path, runs: Sequence[Run]) -> str:
    """Which scenes, and how many moves they took."""
    kind = json.loads((folder / ARGUMENTS).read_text())
    started = len(list(folder.glob(f"z*/*/{REPORT_NAME}")))
    moves = Counter(run.moves - 1 for run in runs)
    told = ", ".join(f"{count} with {n}" for n, count in sorted(moves.items()))
    more = "".join(f", `{one}`" for one in kind["set"])
    return (
        f"Scenes of the test split of seed {kind['seed']} with a plan by {kind['solved_by']}, planned by "
        f"`{kind['planner']}`{more}; {started - len(runs)} unfinished. Rearrangements tried: {told}."
    )


def read(title: str, folder: Path) -> Iterator[Run]:
    """The finished executions of a folder, in order."""
    for path in sorted(folder.glob(f"z*/*/{REPORT_NAME}")):
        report = json.loads(path.read_text())
        if not report["finished"]:
            continue
        moves = report["moves"]
        yield Run(
            title=title,
            obstacles=int(path.parts[-3][1:]),
            number=path.parts[-2],
            disturbance=next((one["text"] for one in report["events"] if one["event"] == "disturbance"), ""),
            outcome=report["outcome"],
            refused=report["refused"],
            success=report["success"],
            claimed=report["claimed"],
            toppled=report["outcome"] == "toppled" or report["conditions"].get("all_upright") is False,
            moves=len(moves),
            faults=_count(report, "fault"),
            plans=_count(report, "plan"),
            pushed=sum(move["others_moved_mm"] > PUSHED_MM for move in moves),
            others_moved_mm=max((move["others_moved_mm"] for move in moves), default=0.0),
            placement_error_mm=max((e for m in moves if (e := m["placement_error_mm"]) is not None), default=None),
            tilt_deg=max((move["tilt_deg"] for move in moves), default=0.0),
            grasp_margin_mm=min((move["grasp_margin_mm"] for move in moves), default=0.0),
            simulated_s=report["simulated_s"],
            rehearsal_s=report["rehearsal_s"],
            wall_s=report["wall_s"],
            message=report["message"],
        )


def _count(report: dict[str, Any], kind: str) -> int:
    """How often a closed loop noted an event; an open one notes none."""
    return sum(event["event"] == kind for event in report["events"])


def _summary(runs: Sequence[Run]) -> Table:
    """A line for each number of obstacles, and for all."""
    columns = sorted({run.obstacles for run in runs})
    lines = [_line(str(z), [run for run in runs if run.obstacles == z]) for z in columns]
    return [
        ["obstacles", "runs", "refused", "success (%)", "wrong claims", "toppled", "faults seen", "plans made", "moves",
         "pushed > 5 mm (%)", "worst placement of a run, mm: mean, max", "simulated s", "wall s: median, max"],
        *lines,
        _line("all", runs),
    ]  # fmt: skip


def _line(name: str, runs: Sequence[Run]) -> list[str]:
    moves, pushed = sum(run.moves for run in runs), sum(run.pushed for run in runs)
    share, wall = wilson(sum(run.success for run in runs), len(runs)), [run.wall_s for run in runs]
    placed = [run.placement_error_mm for run in runs if run.placement_error_mm is not None]
    loops = [run for run in runs if run.plans]
    return [
        name,
        str(len(runs)),
        str(sum(run.refused for run in runs)),
        f"{100 * share.value:.1f} [{100 * share.low:.1f}, {100 * share.high:.1f}]",
        str(sum(run.claimed and not run.success for run in loops)) if loops else "-",
        str(sum(run.toppled for run in runs)),
        str(sum(run.faults for run in loops)) if loops else "-",
        str(sum(run.plans for run in loops)) if loops else "-",
        str(moves),
        f"{100 * pushed / max(1, moves):.2f}",
        f"{fmean(placed):.2f}, {max(placed):.2f}" if placed else "-",
        f"{fmean(run.simulated_s for run in runs):.1f}",
        f"{percentile(wall, 50):.1f}, {max(wall):.1f}",
    ]


def _others(runs: Sequence[Run]) -> list[str]:
    """Every run that did not succeed, by name."""
    failed = [run for run in runs if not run.success]
    if not failed:
        return ["Every run succeeded."]
    counted = ", ".join(f"{n} {outcome}" for outcome, n in Counter(run.outcome for run in failed).most_common())
    listed = [f"- {run.obstacles} obstacles, run {run.number}: {run.outcome}: {run.message}" for run in failed]
    return [f"{len(failed)} did not: {counted}.", "", *listed]


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], {k: Path(v) for k, v in (one.split("=", 1) for one in sys.argv[3:])})
