"""The training loop's speed as CSV, Markdown and a figure, from the lines of scripts/bench_training.py alone.

python -m scripts.training_speed_page ROWS REPORT: ROWS is what scripts/training_speed.sh has measured; REPORT.csv,
REPORT.md and REPORT.png are written.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from dore.errors import InputError, atomic_write
from dore.tables import Table, as_markdown
from scripts.report_files import Report, write_report
from scripts.training_speed_figure import draw
from scripts.training_speed_rows import Speed, read_speeds


class Compared(NamedTuple):
    """A run before, and after: title and name of each way to run it now."""

    title: str
    before: str
    after: tuple[tuple[str, str], ...]


BOTH = ("float32", "bfloat16")
COMPARED = (
    Compared("literal", "before/literal", (("after", "after/literal"),)),
    Compared("planes", "before/planes", tuple((f"after, {name}", f"after/planes/{name}") for name in BOTH)),
    Compared("lanes", "before/lanes", tuple((f"after, {name}", f"after/lanes/{name}") for name in BOTH)),
)
BOARDS = tuple(f"after/board/{side}x{side}" for side in (6, 7, 8, 10))
CORES = {
    "after/cores/one": "one process, one thread",
    "after/cores/threads": "one process, two threads",
    "after/cores/processes": "two processes, one thread each",
}
WHAT = """\
- `literal`: the paper's separated DQN with Table 5's numbers, batches of 32 (`experiment=paper/table4`; it learns from
  2,000 transitions on, which does not change the speed).
- `planes`: what was the default agent before, 512 environments, batches of 512.
- `lanes`: the default agent now (`experiment=table4`), 256 environments, batches of 256.

What was changed:

- The optimiser is fused Adam (`optimizer.fused`): one pass over each weight.
- One sample and one decoding for all updates of a step: observations and masks of `updates_per_step` batches at once.
- The networks may multiply in bfloat16 while they learn (`training.precision`); weights and errors stay float32.
- The lanes' costs are a product of matrices, and sums over tables of bytes. They look further than before, so on
  `lanes` the loop does more after than before.
- The mean of the weights (`training.averaging`) is new, and is time spent; the literal form has none."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the three files; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rows", type=Path)
    parser.add_argument("report", type=Path)
    chosen = parser.parse_args(arguments)
    return write_report("training_speed_page", chosen.report, lambda: _report(chosen.rows, chosen.report.name))


def _report(rows: Path, name: str) -> Report:
    speeds = read_speeds(rows)
    wanted = [name for one in COMPARED for name in (one.before, *(name for _, name in one.after))]
    if missing := [name for name in (*wanted, *BOARDS, *CORES) if name not in speeds]:
        raise InputError(f"{rows}: no {', '.join(missing)}; want what scripts/training_speed.sh measures")
    return Report(
        lambda path: write_csv(path, speeds.values()), lambda path: draw_speeds(path, speeds), page(speeds, name)
    )


def write_csv(path: Path, speeds: Iterable[Speed]) -> None:
    """A line a run, all its rounds together."""
    with atomic_write(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        for number, one in enumerate(speeds):
            line: dict[str, object] = {
                "name": one.name,
                "commit": " ".join(sorted(one.commits)),
                **{key: one.about[key] for key in ("board", "num_envs", "batch_size", "processes", "threads")},
                "rounds": one.rounds,
                "seconds": f"{one.seconds:.2f}",
                "cpu_share": f"{one.of_core:.3f}",
                "load_low": f"{min(one.loads):.2f}",
                "load_high": f"{max(one.loads):.2f}",
                "env_steps_per_s": f"{one.env_steps_per_s:.1f}",
                "updates_per_s": f"{one.updates_per_s:.2f}",
                "samples_per_s": f"{one.samples_per_s:.1f}",
                **{f"share_{stage.replace(' ', '_')}": f"{share:.4f}" for stage, share in one.shares.items()},
            }
            if not number:
                writer.writerow(line)
            writer.writerow(line.values())


def draw_speeds(path: Path, speeds: Mapping[str, Speed]) -> None:
    """The figure of these runs."""
    groups = []
    for one in COMPARED:
        before = speeds[one.before]
        bars = [(f"{one.title}, before", before, before)]
        groups.append(bars + [(f"{one.title}, {kind}", speeds[name], before) for kind, name in one.after])
    smallest = speeds[BOARDS[0]]
    draw(path, groups, [(_board(speeds[name]), speeds[name], smallest) for name in BOARDS])


def page(speeds: Mapping[str, Speed], name: str) -> list[str]:
    """The Markdown, line by line."""
    return [
        "# The training loop's speed",
        "",
        _header(list(speeds.values())),
        "",
        "Measured is `Trainer.iterate` after its start: a step of all environments by the exploring policy, its "
        "storing, and the updates after it; no tests, no checkpoints. Environment steps and updates keep step with "
        "each other, so one ratio holds for both.",
        "",
        "## Before and after, 8 x 8, 3-13 obstacles",
        "",
        as_markdown(_compared(speeds)),
        "",
        WHAT,
        "",
        f"![Where the time of an iteration goes, as stacked bars]({name}.png)",
        "",
        "## Where the time goes, % of an iteration",
        "",
        as_markdown(_stages(speeds)),
        "",
        "Stages do not overlap. Decoding: observations and masks of what was sampled; loss: all forward passes, those "
        "of the target networks too; rest: what is in no other.",
        "",
        "## Over boards",
        "",
        "`experiment=table4`, 20 % of the cells hold an obstacle.",
        "",
        as_markdown(_boards(speeds)),
        "",
        "## On two cores",
        "",
        "`experiment=table4 column=8x8_z3-13`: `lanes` in bfloat16 again, measured beside the others. Two processes "
        "are two runs at once, their rates added up.",
        "",
        as_markdown(_cores(speeds)),
    ]


def _header(speeds: Sequence[Speed]) -> str:
    """Commits, machine, and how quiet it was."""
    commits = {tree: sorted({c for one in speeds if one.name.startswith(tree) for c in one.commits})
               for tree in ("before", "after")}  # fmt: skip
    about, loads = speeds[0].about, [load for one in speeds for load in one.loads]
    rounds = max(one.rounds for one in speeds)
    own = min(one.of_core for one in speeds if one.about["threads"] == 1)
    return (
        f"`scripts/training_speed.sh`, commits {', '.join(commits['before'])} before and {', '.join(commits['after'])} "
        f"after, seed 0, torch {about['torch']}, {about['machine']}, {about['cores']} cores, one thread where nothing "
        f"else is said; {rounds} rounds in turn, {speeds[0].seconds / speeds[0].rounds:.0f} s each. Load from "
        f"{min(loads):.2f} to {max(loads):.2f}, the measured program itself included; a process of one thread "
        f"had {100 * own:.0f} % of a core or more."
        + (" In brackets: the slowest and the fastest round." * (rounds > 1))
    )


def _compared(speeds: Mapping[str, Speed]) -> Table:
    head = ["", "after / before", "env steps/s before", "after", "updates/s before", "after", "samples/s after", "load"]
    table = [head]
    for one in COMPARED:
        before = speeds[one.before]
        for kind, name in one.after:
            after = speeds[name]
            table.append(
                [
                    f"{one.title}, {kind}",
                    f"**{after.env_steps_per_s / before.env_steps_per_s:.2f}**",
                    *(_steps(before), _steps(after)),
                    *(f"{speed.updates_per_s:,.1f}" for speed in (before, after)),
                    f"{after.samples_per_s:,.0f}",
                    _load(before, after),
                ]
            )
    return table


def _stages(speeds: Mapping[str, Speed]) -> Table:
    shown = [
        (f"{one.title}, {kind}", speeds[name])
        for one in COMPARED
        for kind, name in (("before", one.before), *one.after)
    ]
    table = [["stage", *(label for label, _ in shown)]]
    for stage in shown[0][1].shares:
        table.append([stage, *(f"{100 * speed.shares[stage]:.1f}" for _, speed in shown)])
    return [*table, ["ms an update", *(f"{1000 / speed.updates_per_s:.2f}" for _, speed in shown)]]


def _boards(speeds: Mapping[str, Speed]) -> Table:
    smallest = speeds[BOARDS[0]]
    table = [["board", "obstacles", f"of {_board(smallest)}", "env steps/s", "updates/s", "load"]]
    for name in BOARDS:
        one = speeds[name]
        ratio = f"**{one.env_steps_per_s / smallest.env_steps_per_s:.2f}**"
        obstacles = str(one.about["obstacles"][1])
        table.append([_board(one), obstacles, ratio, _steps(one), f"{one.updates_per_s:,.1f}", _load(one)])
    return table


def _cores(speeds: Mapping[str, Speed]) -> Table:
    alone = speeds[next(iter(CORES))]
    table = [["", "of one", "env steps/s", "updates/s", "load"]]
    for name, label in CORES.items():
        one = speeds[name]
        ratio = f"**{one.env_steps_per_s / alone.env_steps_per_s:.2f}**"
        table.append([label, ratio, _steps(one), f"{one.updates_per_s:,.1f}", _load(one)])
    return table


def _board(speed: Speed) -> str:
    return str(speed.about["board"]).replace("x", " x ")


def _steps(speed: Speed) -> str:
    """Environment steps a second, with the slowest and the fastest round where there are several."""
    rounds = f" [{speed.slowest:,.0f}, {speed.fastest:,.0f}]" if speed.rounds > 1 else ""
    return f"{speed.env_steps_per_s:,.0f}{rounds}"


def _load(*speeds: Speed) -> str:
    loads = [load for one in speeds for load in one.loads]
    return f"{min(loads):.2f}-{max(loads):.2f}"


if __name__ == "__main__":
    sys.exit(main())
