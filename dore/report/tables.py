"""Tables from rows.csv alone: how often each planner succeeds, how much it moves, how long it thinks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import stdev

import numpy as np

from dore.errors import InputError
from dore.report import estimates
from dore.report.estimates import Estimate
from dore.report.evaluation import Row
from dore.world.plan import Status


@dataclass(frozen=True)
class Summary:
    """One planner over all rows.

    success: of all instances. success_of_solvable: of those that can be solved; nan unless the planners together
        solved, or proved unsolvable, every instance.
    moves, moves_sd: rearrangements over the instances it solved; planning_*_ms: over all instances.
    """

    planner: str
    instances: int
    solved: int
    success: Estimate
    success_of_solvable: Estimate
    moves: Estimate
    moves_sd: float
    planning_p50_ms: float
    planning_p99_ms: float
    timing: str


@dataclass(frozen=True)
class Paired:
    """One planner on the instances that every planner solved, so that easy and hard ones weigh the same.

    difference: its rearrangements less the reference's, instance by instance.
    ratio: its mean over the reference's; nan where the reference moves nothing.
    """

    planner: str
    reference: str
    instances: int
    moves: Estimate
    moves_sd: float
    difference: Estimate
    ratio: Estimate

    @property
    def change_percent(self) -> float:
        """How far the ratio is from 1."""
        return 100 * (self.ratio.mean - 1)


def summarise(rows: Sequence[Row]) -> list[Summary]:
    """A summary for each planner, in the order of the rows.

    Raises:
        InputError: no rows, planners that saw different instances, or a planner with two rows of one.
    """
    groups = _by_planner(rows)
    unsolvable = {row.instance for row in rows if row.status is Status.UNSOLVABLE}
    solvable = {row.instance for row in rows if row.status is Status.SOLVED}
    decided = unsolvable | solvable == {row.instance for row in rows}
    summaries = []
    for planner, group in groups.items():
        solved = [row for row in group.values() if row.status is Status.SOLVED]
        moves = [float(row.moves) for row in solved]
        taken_ms = [1000 * row.planning_s for row in group.values()]
        summaries.append(
            Summary(
                planner,
                len(group),
                len(solved),
                estimates.share(len(solved), len(group)),
                estimates.share(len(solved), len(solvable)) if decided and solvable else Estimate(),
                estimates.mean(moves),
                stdev(moves) if len(moves) > 1 else math.nan,
                float(np.percentile(taken_ms, 50)),
                float(np.percentile(taken_ms, 99)),
                "/".join(sorted({row.timing for row in group.values()})),
            )
        )
    return summaries


def compare(rows: Sequence[Row], reference: str | None = None) -> list[Paired]:
    """Every planner against one of them (the last by default) on the instances that all of them solved.

    Raises:
        InputError: an unknown reference, or what `summarise` raises.
    """
    groups = _by_planner(rows)
    reference = list(groups)[-1] if reference is None else reference
    if reference not in groups:
        raise InputError(f"reference: got {reference!r}, want one of {', '.join(groups)}")
    common = sorted(
        number
        for number in groups[reference]
        if all(group[number].status is Status.SOLVED for group in groups.values())
    )
    base = [groups[reference][number].moves for number in common]
    paired = []
    for planner, group in groups.items():
        moves = [float(group[number].moves) for number in common]
        difference = estimates.mean([mine - theirs for mine, theirs in zip(moves, base, strict=True)])
        spread, ratio = stdev(moves) if len(moves) > 1 else math.nan, estimates.ratio(moves, base)
        paired.append(Paired(planner, reference, len(common), estimates.mean(moves), spread, difference, ratio))
    return paired


def _by_planner(rows: Sequence[Row]) -> dict[str, dict[int, Row]]:
    """The rows of each planner by instance number."""
    if not rows:
        raise InputError("rows: got none, want one or more")
    groups: dict[str, dict[int, Row]] = {}
    for row in rows:
        group = groups.setdefault(row.planner, {})
        if row.instance in group:
            raise InputError(f"rows: {row.planner} has two rows of instance {row.instance}")
        group[row.instance] = row
    first, *others = groups
    for planner in others:
        if groups[planner].keys() != groups[first].keys():
            raise InputError(f"rows: {planner} and {first} were run on different instances")
    return groups


Table = list[list[str]]
"""Header first; every row as long as the header."""


def summary_table(summaries: Sequence[Summary]) -> Table:
    """What `summarise` found, to read."""
    header = [
        "planner",
        "instances",
        "solved %",
        "of solvable %",
        "rearrangements",
        "sd",
        "p50 ms",
        "p99 ms",
        "timing",
    ]
    return [header] + [
        [
            one.planner,
            str(one.instances),
            _interval(one.success, 100, 1),
            _interval(one.success_of_solvable, 100, 1),
            _interval(one.moves, 1, 2),
            _number(one.moves_sd, 2),
            _number(one.planning_p50_ms, 2),
            _number(one.planning_p99_ms, 2),
            one.timing,
        ]
        for one in summaries
    ]


def paired_table(paired: Sequence[Paired]) -> Table:
    """What `compare` found, to read."""
    reference = paired[0].reference
    header = ["planner", "solved by all", "rearrangements", "sd", f"less {reference}", "change %"]
    return [header] + [
        [
            one.planner,
            str(one.instances),
            _interval(one.moves, 1, 2),
            _number(one.moves_sd, 2),
            _interval(one.difference, 1, 2) if one.planner != reference else "",
            f"{one.change_percent:+.1f}" if one.planner != reference and one.instances else "",
        ]
        for one in paired
    ]


def as_text(table: Table) -> str:
    """Columns aligned with spaces: the first to the left, the others to the right."""
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    lines = [
        "  ".join([row[0].ljust(widths[0]), *(cell.rjust(w) for cell, w in zip(row[1:], widths[1:], strict=True))])
        for row in table
    ]
    rule = "  ".join("-" * width for width in widths)
    return "\n".join(line.rstrip() for line in [lines[0], rule, *lines[1:]])


def as_markdown(table: Table) -> str:
    """A Markdown table, aligned like `as_text`."""
    rule = ["---"] + ["---:"] * (len(table[0]) - 1)
    return "\n".join("| " + " | ".join(row) + " |" for row in [table[0], rule, *table[1:]])


def _interval(interval: Estimate, scale: float, digits: int) -> str:
    value = _number(scale * interval.mean, digits)
    if math.isnan(interval.low):
        return value
    return f"{value} [{_number(scale * interval.low, digits)}, {_number(scale * interval.high, digits)}]"


def _number(value: float, digits: int) -> str:
    """A number, or a dash where there is none."""
    return "-" if math.isnan(value) else f"{value:.{digits}f}"
