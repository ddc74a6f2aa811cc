"""What Table 4 says, worked out from the runs alone: each metric, and on which instances it is taken."""

from __future__ import annotations

import math
from collections.abc import Callable
from statistics import fmean

from dore.report.evaluation import Row
from dore.report.intervals import ratio_interval
from dore.world.plan import Status
from scripts.entry_tables import spread
from scripts.learning_curves import Ipt, reached
from scripts.paper_entries import Entry, Metric, point, share
from scripts.table4_runs import PAPER, Runs, Trained

SUCCESS, RATIO = "success of the solvable (%)", "rearrangements / proved optimum"
STRUCTURES = {"single": "S-DQN", "sequential": "SS-DQN"}
"""What the paper calls them."""
IMPROVED = "improved, over seeds"
WANTED = 0.95
"""The IPT success that ends the paper's training (S_T)."""

Value = Callable[[list[Row], list[Row], str, str], Entry]
"""A cell from a planner's rows and the proved ones, with its row's and its column's name."""


def metrics_of(runs: Runs) -> list[Metric]:
    """All tables of the page."""
    ratio_note = "The ratio of the means, on the instances that both solve."
    return [
        Metric(SUCCESS, _success_note(runs), [*_paper(runs), *_cells(runs, _success), *_solvable(runs)], digits=4),
        Metric(RATIO, ratio_note, [*_cells(runs, _over_optimum), *_optimum(runs)], digits=4),
        _endings(runs),
        _literal(runs),
        _improved(runs),
        _sooner(runs, "episodes", lambda tested: tested.episodes),
        _sooner(runs, "seconds", lambda tested: tested.seconds),
    ]


def _success_note(runs: Runs) -> str:
    undecided = {column: _undecided(runs, column) for column in runs.columns}
    left = ", ".join(f"{n} in {column}" for column, n in undecided.items() if n)
    return (
        "Greedy, on the instances of the test split that some planner solves; the paper's figure is of all instances. "
        "Each with Wilson's 95 % interval; over seeds: mean (sd) [lowest, highest]. "
        + (
            f"Neither solved nor proved to have no plan, and so left out: {left}."
            if left
            else "No instance is undecided."
        )
    )


def _paper(runs: Runs) -> list[Entry]:
    return [
        point(f"paper: {name}", column, PAPER[structure][column], None)
        for structure, name in STRUCTURES.items()
        for column in runs.columns
    ]


def _cells(runs: Runs, value: Value) -> list[Entry]:
    """Our rows, in the page's order."""
    entries = []
    for structure, name in STRUCTURES.items():
        for column in runs.columns:
            if rows := runs.rows[column].get(structure):
                entries.append(value(rows, _known(runs, column), f"literal: {name}", column))
    for column in runs.columns:
        seeds = [rows for name, rows in runs.rows[column].items() if name.startswith("seed")]
        if seeds:
            each = [value(rows, _known(runs, column), IMPROVED, column) for rows in seeds]
            entries.append(spread(IMPROVED, column, [one.value.value for one in each]))
    for planner, name in (("learned", "generalist"), ("guided", "generalist, guided")):
        for column in runs.columns:
            rows = [row for row in runs.rows[column].get("generalist", []) if row.planner == planner]
            if rows:
                entries.append(value(rows, _known(runs, column), name, column))
    return entries


def _known(runs: Runs, column: str) -> list[Row]:
    """For each instance that has a plan one row: the proved one, or, where the proof gave up, any that solved it."""
    best: dict[int, Row] = {}
    for rows in (runs.rows[column]["exact"], *runs.rows[column].values()):
        for row in rows:
            if row.status is Status.SOLVED:
                best.setdefault(row.instance, row)
    return list(best.values())


def _undecided(runs: Runs, column: str) -> int:
    every = [row for rows in runs.rows[column].values() for row in rows]
    decided = {row.instance for row in every if row.status in (Status.SOLVED, Status.UNSOLVABLE)}
    return len({row.instance for row in every} - decided)


def _success(rows: list[Row], known: list[Row], name: str, column: str) -> Entry:
    solved = sum(row.status is Status.SOLVED for row in rows)
    return share(name, column, solved, len(known))


def _over_optimum(rows: list[Row], known: list[Row], name: str, column: str) -> Entry:
    optimum = {row.instance: row.moves for row in known if row.planner == "exact"}
    both = [row for row in rows if row.status is Status.SOLVED and row.instance in optimum]
    moves, least = [float(row.moves) for row in both], [float(optimum[row.instance]) for row in both]
    return Entry(name, column, len(both), ratio_interval(moves, least))


def _solvable(runs: Runs) -> list[Entry]:
    return [
        share("of all instances, solvable", column, len(_known(runs, column)), len(runs.rows[column]["exact"]))
        for column in runs.columns
    ]


def _optimum(runs: Runs) -> list[Entry]:
    """The proved optimum itself."""
    entries = []
    for column in runs.columns:
        moves = [row.moves for row in runs.rows[column]["exact"] if row.status is Status.SOLVED]
        entries.append(point("proved optimum, rearrangements", column, fmean(moves) if moves else math.nan, len(moves)))
    return entries


def _endings(runs: Runs) -> Metric:
    """What becomes of the instances that are not solved."""
    names = {**{key: f"literal: {name}" for key, name in STRUCTURES.items()}, "seed0": "improved, seed 0"}
    entries = []
    for key, name in names.items():
        tested = {column: rows for column in runs.columns if (rows := runs.rows[column].get(key))}
        reasons = sorted({row.reason for rows in tested.values() for row in rows if row.status is not Status.SOLVED})
        for reason in reasons:
            for column, rows in tested.items():
                ended = sum(row.status is not Status.SOLVED and row.reason == reason for row in rows)
                entries.append(point(f"{name}: {reason}", column, 100 * ended / len(rows), len(rows)))
    note = (
        "Percent of all instances, those without a plan among them. `move budget`: the step limit; the others are the "
        "failures of section 5.1 of the paper, or no move that is legal."
    )
    return Metric("how what is not solved ends (%)", note, entries)


def _literal(runs: Runs) -> Metric:
    """How far the literal runs went."""
    entries = []
    for structure, name in STRUCTURES.items():
        for what, value in {**_FIGURES, **_LITERAL}.items():
            for column in runs.columns:
                if run := runs.literal.get((structure, column)):
                    entries.append(point(f"{name}: {what}", column, value(run), 1))
    note = (
        "Table 5's numbers; T_lim is 15 |E_r| episodes. A run ends where five IPT batches pass (the paper's early "
        "stop), else when its minutes are spent."
    )
    return Metric("how far the literal runs went", note, entries, digits=4)


def _before_copies(run: Trained) -> float:
    """The best IPT, in percent, while the targets are still those of the untrained networks."""
    every = run.cfg.target_update.get("value_network_update_interval", 0) + 1
    return 100 * max((one.success for one in run.tests if one.updates < every), default=math.nan)


_LITERAL: dict[str, Callable[[Trained], float]] = {
    "best IPT before targets are first copied (%)": _before_copies,
    "last IPT (%)": lambda run: 100 * run.tests[-1].success if run.tests else math.nan,
}
_FIGURES: dict[str, Callable[[Trained], float]] = {
    "episodes": lambda run: run.done["episodes"],
    "of T_lim (%)": lambda run: 100 * run.done["episodes"] / run.cfg.training.max_episodes,
    "updates": lambda run: run.done["updates"],
    "minutes": lambda run: run.done["seconds"] / 60,
    "IPT of the kept model (%)": lambda run: 100 * run.done["best_success"],
    "passed (1 yes, 0 no)": lambda run: float(run.done["ending"] == "passed"),
}


def _improved(runs: Runs) -> Metric:
    entries = []
    for what, value in _FIGURES.items():
        for column in runs.columns:
            each = [run for (_, one), run in runs.improved.items() if one == column]
            if each and "T_lim" not in what:
                entries.append(spread(what, column, [value(run) for run in each]))
    return Metric("the improved runs", "Mean (sd) [lowest, highest] over seeds.", entries, digits=4)


def _firsts(runs: Runs, column: str, value: Callable[[Ipt], float]) -> list[float]:
    """When each seed's IPT first reaches what is wanted; a seed where it does not is left out."""
    firsts = [reached(run.tests, WANTED) for (_, one), run in runs.sooner.items() if one == column]
    return [value(first) for first in firsts if first is not None]


def _sooner(runs: Runs, what: str, value: Callable[[Ipt], float]) -> Metric:
    """How soon the IPT reaches the paper's 95 %, and how many times sooner the improved agents do."""
    ours = {column: _firsts(runs, column, value) for column in runs.columns}
    entries = [spread(IMPROVED, column, ours[column]) for column in runs.columns]
    for structure, name in STRUCTURES.items():
        for column in runs.columns:
            run = runs.literal.get((structure, column))
            first = None if run is None else reached(run.tests, WANTED)
            theirs = math.nan if first is None else value(first)
            # A run that has not reached it bounds the ratio by all that it was given.
            least = value(run.tests[-1]) if run is not None and run.tests and first is None else math.nan
            mean = fmean(ours[column]) if ours[column] else math.nan
            entries += [
                point(f"literal: {name}", column, theirs, 1),
                point(f"literal {name} / improved", column, theirs / mean, 1),
                point(f"literal {name} / improved, more than", column, least / mean, 1),
            ]
    note = (
        f"The first IPT, every 1,000 episodes, at or above {100 * WANTED:g} % of all instances; over the seeds that "
        "reach it: mean (sd) [lowest, highest]. "
        "A dash: not within the run; `more than`: its last test over ours, where it has not come so far."
    )
    return Metric(f"{what} to {100 * WANTED:g} % IPT", note, entries, digits=4)
