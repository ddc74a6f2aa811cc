"""docs/results/literal.md: how far the paper's runs as printed have come (scripts/literal.sh).

python -m scripts.literal rows RUN docs/results/literal/NAME   a run's tests as NAME.csv, and what it is as NAME.json
python -m scripts.literal page [docs/results/literal]          the page and its figure, from these files
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from dore.app.run_folder import DONE, METRICS, read_config
from dore.errors import InputError
from dore.files import atomic_write
from dore.report.study import paper_table
from scripts.literal_figure import draw

COLUMNS = (
    *("episodes", "updates", "share_of_episodes", "share_of_updates"),
    *("ipt", "loss", "epsilon", "target_copies"),
)
HEAD = (
    *("structure", "column", "seed", "reading", "paper %", "last %", "best % (at update)"),
    *("updates", "of T_lim", "copies", "state"),
)
PAPER = {
    key: {one.column: one.mean for one in paper_table("success").itertuples() if one.method == name}
    for key, name in (("single", "S-DQN"), ("sequential", "SS-DQN"))
}
MOST_ROWS = 1100
"""Tests of a run in its CSV file, evenly spaced; the last one always."""


@dataclass(frozen=True)
class Test:
    """One IPT. shares: of T_lim. ipt: success, %. loss: of the updates just before it. target_copies: so far."""

    __test__ = False

    episodes: int
    updates: int
    share_of_episodes: float
    share_of_updates: float
    ipt: float
    loss: float
    epsilon: float
    target_copies: int


@dataclass(frozen=True)
class Run:
    """A run of the list. reading: what it changes of the paper's preset. ending: None while it goes on.

    t_lim: episodes. t_lim_updates: made in these; an estimate where there is one a step. copy_every: updates between
    two copies of the targets.
    """

    name: str
    structure: str
    column: str
    seed: int
    reading: str
    t_lim: int
    t_lim_updates: int
    copy_every: int
    commit: str | None
    ending: str | None
    tests: tuple[Test, ...] = ()

    @property
    def paper(self) -> float:
        """The paper's success in Table 4, %."""
        return PAPER[self.structure][self.column]


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the files of a run, or the page; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    rows = commands.add_parser("rows")
    rows.add_argument("run", type=Path)
    rows.add_argument("out", type=Path)
    page = commands.add_parser("page")
    page.add_argument("folder", type=Path, nargs="?", default=Path("docs/results/literal"))
    chosen = parser.parse_args(arguments)
    try:
        if chosen.command == "rows":
            write_run(run_of(chosen.run), chosen.out)
        else:
            write_page(chosen.folder)
    except InputError as error:
        print(f"literal: {error}", file=sys.stderr)
        return 2
    return 0


def run_of(folder: Path) -> Run:
    """What a run folder says of a literal run.

    Raises:
        InputError: no run folder, or a damaged one.
    """
    cfg = read_config(folder, ("agent", "layout", "instances", "training", "target_update", "seed"))
    about, done = _json(folder / "about.json"), _json(folder / DONE)
    every = cfg.target_update.value_network_update_interval + 1
    t_lim = cfg.training.max_episodes
    rows = [row for row in _rows(folder / METRICS) if row["success"] and int(row["updates"])]
    a_step = cfg.training.update_after == "step"
    ratio = int(rows[-1]["updates"]) / int(rows[-1]["episodes"]) if a_step and rows else cfg.training.updates
    tests = [
        Test(
            episodes=int(row["episodes"]),
            updates=int(row["updates"]),
            share_of_episodes=round(int(row["episodes"]) / t_lim, 6),
            share_of_updates=round(int(row["updates"]) / (t_lim * ratio), 6),
            ipt=round(100 * float(row["success"]), 3),
            loss=round(float(row["loss"]), 5),
            epsilon=round(float(row["epsilon"]), 4),
            target_copies=int(row["updates"]) // every,
        )
        for row in rows
    ]
    thin = -(-t_lim // cfg.ipt.every_episodes // MOST_ROWS)
    kept = [test for n, test in enumerate(tests, 1) if n % thin == 0 or n == len(tests)]
    structure = "single" if cfg.agent._target_.endswith(".Single") else "sequential"
    column = f"{cfg.layout.rows}x{cfg.layout.cols}_z{cfg.instances.min_obstacles}-{cfg.instances.max_obstacles}"
    reading = folder.name.removeprefix(f"{structure}_{column}").removesuffix(f"seed{cfg.seed}").strip("_")
    return Run(
        *(folder.name, structure, column, cfg.seed, reading, t_lim, round(t_lim * ratio), every),
        commit=about.get("commit"),
        ending=done.get("ending"),
        tests=tuple(kept),
    )


def write_run(run: Run, out: Path) -> None:
    """NAME.csv and NAME.json."""
    out.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(Path(f"{out}.csv")) as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(asdict(test) for test in run.tests)
    with atomic_write(Path(f"{out}.json")) as file:
        json.dump({name: value for name, value in asdict(run).items() if name != "tests"}, file, indent=2)
        file.write("\n")


def read_runs(folder: Path) -> list[Run]:
    """The runs that `write_run` wrote in a folder.

    Raises:
        InputError: there are none, or one is damaged.
    """
    runs = []
    for about in sorted(folder.glob("*.json")):
        kinds = Test.__annotations__
        try:
            tests = [
                Test(**{name: (int if kinds[name] == "int" else float)(row[name]) for name in COLUMNS})
                for row in _rows(about.with_suffix(".csv"))
            ]
            runs.append(Run(**_json(about), tests=tuple(tests)))
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{about.with_suffix('.csv')}: damaged ({error})") from None
    if not runs:
        raise InputError(f"{folder}: holds no run; scripts/literal.sh makes them")
    order = list(PAPER["single"])
    return sorted(runs, key=lambda run: (run.reading, run.structure == "single", order.index(run.column), run.seed))


def write_page(folder: Path) -> None:
    """FOLDER.md and FOLDER.png."""
    runs = read_runs(folder)
    draw(folder.with_suffix(".png"), runs)
    with atomic_write(folder.with_suffix(".md")) as file:
        file.write("\n".join(lines_of(runs, folder.name)) + "\n")
    print(folder.with_suffix(".md"))


def lines_of(runs: Sequence[Run], name: str) -> list[str]:
    """The page in Markdown."""
    commits = sorted({run.commit or "unknown" for run in runs})
    return [
        "# The paper's runs as printed",
        "",
        "Algorithm 2 with the numbers of Table 5 (`experiment=paper/...`, `reach=paper_fit`), carried on by",
        "`scripts/literal.sh`; [paper.md](../paper.md) has it line by line against the code. Success is the IPT's:",
        "5 batches of 1,000 instances of E_t, unsolvable ones among them, every 1,000 episodes. A run ends when all",
        "five batches reach 95 %, or at T_lim. `last` is what Algorithm 2 returns; `best` is the highest test on the",
        "way, which the paper does not return. Rows that have not ended say how far they are. Each run's tests are in",
        f"[{name}/]({name}), one file a run.",
        "",
        f"![Success against updates, a panel a run]({name}.png)",
        "",
        f"| {' | '.join(HEAD)} |",
        "| --- | --- | ---: | --- | ---: | ---: | ---: | ---: | ---: | ---: | --- |",
        *(_row(run) for run in runs),
        "",
        f"Code: {', '.join(commits)}. Made by `python -m scripts.literal page`.",
    ]


def _row(run: Run) -> str:
    head = f"| {run.structure} | {run.column.replace('_z', ', ')} | {run.seed} | {run.reading or 'as printed'} "
    if not run.tests:
        return f"{head}| {run.paper:g} | - | - | 0 | 0 % | 0 | fills its replay |"
    last, best = run.tests[-1], max(run.tests, key=lambda test: test.ipt)
    state = {None: "under way", "passed": "early stop", "budget": "at T_lim"}[run.ending]
    return (
        f"{head}| {run.paper:g} | {last.ipt:.1f} | {best.ipt:.1f} ({best.updates:,}) | {last.updates:,} "
        f"| {100 * last.share_of_episodes:.1f} % | {last.target_copies} | {state} |"
    )


def _rows(path: Path) -> list[dict[str, str]]:
    try:
        with open(path, encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None


def _json(path: Path) -> dict[str, Any]:
    """What a JSON file holds; nothing where there is none."""
    try:
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    return found


if __name__ == "__main__":
    sys.exit(main())
