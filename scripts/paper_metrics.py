"""What Tables 1 to 3 say, worked out from rows alone: each metric, and on which instances it is taken."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from dore.errors import InputError
from dore.report.evaluation import Row, Timing
from dore.report.intervals import Interval, percentile, ratio_interval
from dore.report.tables import Paired, compare, summarise
from dore.world.plan import Status
from scripts.paper_entries import ALL, PAPER, Entry, Metric, mean, means_over_columns, of_paper, point, scaled, share
from scripts.paper_rows import REARRANGEMENTS, TABLE_1_PLANNING_S, Cell

SEARCH, BASELINE, EXACT = "graph_search", "straight_line", "exact"
SINGLE, TRANSFER = "learned (single)", "transfer (single)"
PAPER_TL_S = {"3x6": (143.0, 42.8), "6x6": (261.0, 51.4)}
"""Section 6.1: seconds of transfer learning, mean and standard deviation; over how many instances is not said."""
TIME, MEDIAN, SPEEDUP = "planning time (s)", "median planning time (s)", f"planning time, {SEARCH} / {SINGLE}"
MOVES, SAVED, OVER = "rearrangements", f"rearrangements saved against {BASELINE} (%)", "rearrangements / proved optimum"
GAVE_UP, SOLVED, LEARNING = "gave up (%)", "solved of the solvable (%)", "transfer learning (TL)"

Columns = Mapping[int, Sequence[Row]]
"""Every planner's rows by the number of obstacles, `exact` once; `learned` and `transfer` bear their model's name."""


def table_1(columns: Columns) -> list[Metric]:
    """Planning times.

    Raises:
        InputError: times that are no latencies, a planner that is missing, or what `summarise` raises.
    """
    return [_planning_time(columns), _speedup(columns), _median_time(columns), _gave_up(columns), _solved(columns)]


def table_2_or_3(columns: Columns, layout: str) -> list[Metric]:
    """Rearrangements; `layout`, 3x6 or 6x6, says which figures of the paper stand beside ours.

    Raises:
        InputError: a planner that is missing, or what `compare` raises.
    """
    paper = REARRANGEMENTS.get(layout, {})
    metrics = [_rearrangements(columns, paper), _saved(columns, paper), _over_optimum(columns), _solved(columns)]
    return [*metrics, _transfer(columns, PAPER_TL_S.get(layout))]


def _planning_time(columns: Columns) -> Metric:
    entries = of_paper(TABLE_1_PLANNING_S, columns)
    for z, rows in columns.items():
        if {row.timing for row in rows} != {Timing.SINGLE}:
            raise InputError(f"rows: timing of those with {z} obstacles, want {Timing.SINGLE} in all")
        for planner in dict.fromkeys(row.planner for row in rows):
            entries.append(mean(planner, str(z), [row.planning_s for row in _rows_of(rows, planner)]))
    note = (
        "Mean (sd) and 95 % interval over all instances, also those that a planner gave up on, with the time it took."
    )
    return Metric(TIME, note, entries)


def _speedup(columns: Columns) -> Metric:
    search, dqn = TABLE_1_PLANNING_S["graph_search"], TABLE_1_PLANNING_S["dqn"]
    entries = [point("paper", str(z), search[z].mean / dqn[z].mean, search[z].n) for z in columns if z in search]
    for z, rows in columns.items():
        slow, fast = ([row.planning_s for row in _rows_of(rows, planner)] for planner in (SEARCH, SINGLE))
        entries.append(Entry("ours", str(z), len(slow), ratio_interval(slow, fast)))
    return Metric(SPEEDUP, "The ratio of the means above, on the same instances.", entries)


def _median_time(columns: Columns) -> Metric:
    entries = []
    for z, rows in columns.items():
        for planner in dict.fromkeys(row.planner for row in rows):
            seconds = [row.planning_s for row in _rows_of(rows, planner)]
            entries.append(point(planner, str(z), percentile(seconds, 50), len(seconds)))
    return Metric(MEDIAN, "Of the same times: a few long searches can make a mean.", entries)


def _gave_up(columns: Columns) -> Metric:
    entries = []
    for z, rows in columns.items():
        for planner in dict.fromkeys(row.planner for row in rows):
            status = [row.status for row in _rows_of(rows, planner)]
            entries.append(share(planner, str(z), status.count(Status.GAVE_UP), len(status)))
    note = "Of all instances: those that ended without a plan, and without a proof that there is none."
    return Metric(GAVE_UP, note, entries)


def _solved(columns: Columns) -> Metric:
    entries = []
    for z, rows in columns.items():
        solvable = len({row.instance for row in rows if row.status is Status.SOLVED})
        for one in summarise(rows):
            entries.append(Entry(one.planner, str(z), solvable, scaled(one.success_of_solvable, 100)))
    note = "Of the instances that have a plan. A dash: some instance is neither solved nor proved to have no plan."
    return Metric(SOLVED, note, entries)


def _rearrangements(columns: Columns, paper: Mapping[str, Mapping[int, Cell]]) -> Metric:
    entries = of_paper(paper, columns)
    for z, rows in columns.items():
        for one in compare([row for row in rows if row.planner != TRANSFER], reference=EXACT):
            entries.append(Entry(one.planner, str(z), one.instances, one.moves, one.moves_sd))
    note = (
        "Mean (sd) and 95 % interval over the instances that every planner of this table solved, so that easy and "
        f"hard ones weigh the same for all; the paper's own instances are not known. `{EXACT}` is the proved optimum."
    )
    return Metric(MOVES, note, entries)


def _saved(columns: Columns, paper: Mapping[str, Mapping[int, Cell]]) -> Metric:
    theirs, ours = [], []
    for z, rows in columns.items():
        if paper and z in paper["baseline"]:
            base, dqn = paper["baseline"][z], paper["dqn"][z]
            theirs.append(point(PAPER["dqn"], str(z), 100 * (1 - dqn.mean / base.mean), base.n))
        for planner in _policies(rows):
            pair = _paired(rows, planner, (BASELINE,), reference=BASELINE)
            # The fewer moves, the more saved: the ends change places.
            saved = [100 * (1 - ratio) for ratio in (pair.ratio.value, pair.ratio.high, pair.ratio.low)]
            ours.append(Entry(planner, str(z), pair.instances, Interval(*saved)))
    note = (
        f"How many fewer than `{BASELINE}` in the mean, on the instances that both solve. `{ALL}` is the mean of the "
        "columns, and so, it seems, are the 34 % (Table 2) and 36 % (Table 3) of the paper."
    )
    entries = [*theirs, *means_over_columns(theirs), *ours, *means_over_columns(ours)]
    return Metric(SAVED, note, entries)


def _over_optimum(columns: Columns) -> Metric:
    entries = []
    for z, rows in columns.items():
        for planner in (BASELINE, *_policies(rows)):
            if planner != EXACT:
                trio = _paired(rows, planner, (BASELINE, EXACT), reference=EXACT)
                entries.append(Entry(planner, str(z), trio.instances, trio.ratio))
    note = f"The ratio of the means, on the instances that the planner and `{BASELINE}` both solve."
    return Metric(OVER, note, [*entries, *means_over_columns(entries)], digits=4)


def _transfer(columns: Columns, paper: tuple[float, float] | None) -> Metric:
    """What transfer learning does where the single model fails."""
    by_column = {str(z): _failed(rows) for z, rows in columns.items()}
    pooled = [row for failed, _ in by_column.values() for row in failed], sum(n for _, n in by_column.values())
    entries = []
    for column, (failed, trials) in {**by_column, ALL: pooled}.items():
        solved = [row for row in failed if row.status is Status.SOLVED]
        entries += [
            share(f"{SINGLE} fails (%)", column, len(failed), trials),
            share("TL then solves (%)", column, len(solved), len(failed)),
            mean("TL seconds", column, [row.planning_s for row in solved]),
            mean("TL episodes", column, [float(_episodes(row)) for row in solved]),
        ]
    if paper is not None:
        seconds, sd = paper
        ours = next(entry for entry in entries if (entry.row, entry.column) == ("TL seconds", ALL))
        entries.append(point("paper: TL seconds", ALL, seconds, None, sd))
        entries.append(point("TL seconds, paper / ours", ALL, seconds / ours.value.value, ours.n))
    note = (
        f"The instances where `{SINGLE}` fails, less those that are proved to have no plan; how many of them transfer "
        "learning then solves; and its seconds and episodes, mean (sd), on those it solves, as in the paper."
    )
    return Metric(LEARNING, note, entries)


def _failed(rows: Sequence[Row]) -> tuple[list[Row], int]:
    """Transfer learning's rows where the single model failed, and out of how many; without what has no plan."""
    no_plan = {row.instance for row in rows if row.status is Status.UNSOLVABLE}
    base = [row for row in _rows_of(rows, SINGLE) if row.instance not in no_plan]
    failed = {row.instance for row in base if row.status is not Status.SOLVED}
    return [row for row in _rows_of(rows, TRANSFER) if row.instance in failed], len(base)


def _episodes(row: Row) -> int:
    """How many episodes transfer learning took.

    Raises:
        InputError: the row does not say.
    """
    found = re.search(r"after (\d+) episodes", row.reason)
    if found is None:
        raise InputError(f"rows: {row.planner}, instance {row.instance}: reason {row.reason!r}, want the episodes")
    return int(found[1])


def _rows_of(rows: Sequence[Row], planner: str) -> list[Row]:
    """A planner's rows in the order of the instances.

    Raises:
        InputError: there are none.
    """
    mine = sorted((row for row in rows if row.planner == planner), key=lambda row: row.instance)
    if not mine:
        raise InputError(f"rows: none of {planner}, want some")
    return mine


def _policies(rows: Sequence[Row]) -> list[str]:
    """The planners whose rearrangements are compared with the baseline's."""
    return list(dict.fromkeys(row.planner for row in rows if row.planner not in (BASELINE, TRANSFER)))


def _paired(rows: Sequence[Row], planner: str, others: tuple[str, ...], reference: str) -> Paired:
    """`planner` against the reference, on the instances that it and the others solved."""
    paired = compare([row for row in rows if row.planner in (planner, *others)], reference)
    return next(one for one in paired if one.planner == planner)
