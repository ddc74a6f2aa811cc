"""What the generalist's page says, worked out from its evaluations alone."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from statistics import fmean

from dore.report.tables import compare
from dore.world.plan import Status
from scripts.generalist_worlds import PLANNERS, Evaluations, Known, World
from scripts.paper_entries import Entry, Metric, point, share

SUCCESS, OF_ALL, RATIO = "success of the solvable (%)", "of all instances (%)", "rearrangements / proved optimum"
TOGETHER, REACHES, TRAINED = "together (%)", "other reaches", "learned from"


def metrics_of(found: Evaluations) -> list[Metric]:
    """All tables of the page; the last one is for the CSV alone."""
    of_solvable = "Of the instances that some planner solves; Wilson's 95 % interval."
    of_all = (
        "`solvable`: some planner solves it. `undecided`: no planner solves it within its budget, nor proves that "
        "there is no plan; some of these may have one, which success of the solvable leaves out."
    )
    ratio = (
        "The ratio of the means on the instances that the planner and `exact` both solve, and on how many; on dense "
        "boards these are the easier ones. Then the mean of the proved optimum where there is one."
    )
    return [
        Metric(TOGETHER, of_solvable, list(_together(found.worlds))),
        Metric(SUCCESS, of_solvable, [success(world, planner) for planner, world in _each(found.sized)]),
        Metric(OF_ALL, of_all, list(_of_all(found.sized))),
        Metric(RATIO, ratio, list(_ratios(found.sized)), digits=4),
        Metric(REACHES, _reaches_note(found.others), [entry for world in found.others for entry in _reach(world)]),
        Metric(TRAINED, "", [_trained(world) for world in found.worlds]),
    ]


def _trained(world: World) -> Entry:
    """1 where the network has learned from a world, 0 elsewhere."""
    return point(f"{world.reach}, {world.size}", density(world), float(world.known is Known.TRAINED), None)


def density(world: World) -> str:
    """A column's title."""
    return f"{world.percent} %"


def success(world: World, planner: str) -> Entry:
    """A planner's share of the solvable instances."""
    return share(f"{world.size}, {planner}", density(world), world.solved(planner), len(world.solvable))


def over_optimum(world: World, planner: str) -> Entry:
    """A planner's rearrangements over the proved optimum, where both have a plan."""
    (found, _) = compare([*world.rows[planner], *world.rows["exact"]], "exact")
    return Entry(f"{world.size}, {planner}", density(world), found.instances, found.ratio)


def _each(worlds: Sequence[World]) -> Iterator[tuple[str, World]]:
    """A size's planners one after the other, each with all densities."""
    for size in dict.fromkeys(world.size for world in worlds):
        for planner in PLANNERS:
            yield from ((planner, world) for world in worlds if world.size == size)


def _ratios(worlds: Sequence[World]) -> Iterator[Entry]:
    """Each size's planners, and then its optimum."""
    for size in dict.fromkeys(world.size for world in worlds):
        here = [world for world in worlds if world.size == size]
        yield from (over_optimum(world, planner) for planner, world in _each(here))
        for world in here:
            moves = [row.moves for row in world.rows["exact"] if row.status is Status.SOLVED]
            mean = fmean(moves) if moves else math.nan
            yield point(f"{size}, proved optimum", density(world), mean, len(moves))


def _of_all(worlds: Sequence[World]) -> Iterator[Entry]:
    for size in dict.fromkeys(world.size for world in worlds):
        here = [world for world in worlds if world.size == size]
        for planner in PLANNERS:
            for world in here:
                yield share(f"{size}, {planner}", density(world), world.solved(planner), len(world.rows[planner]))
        for what in ("solvable", "undecided"):
            for world in here:
                n = len(world.rows["exact"])
                yield point(f"{size}, {what}", density(world), 100 * len(getattr(world, what)) / n, n)


def _together(worlds: Sequence[World]) -> Iterator[Entry]:
    """All worlds of a kind in one, each instance weighing the same."""
    for planner in PLANNERS:
        for known in Known:
            here = [world for world in worlds if world.known == known]
            if here:
                solved = sum(world.solved(planner) for world in here)
                yield share(planner, known, solved, sum(len(world.solvable) for world in here))


def _reach(world: World) -> Iterator[Entry]:
    """A line of the table of reaches."""
    row, n = f"{world.reach}, {world.size}, {world.percent} %", len(world.rows["exact"])
    yield point(row, "obstacles", world.n_obstacles, None)
    yield point(row, "free at once %", 100 * world.free, None)
    yield point(row, "solvable %", 100 * len(world.solvable) / n, n)
    for planner in PLANNERS:
        one = success(world, planner)
        yield Entry(row, f"{planner}, of the solvable %", one.n, one.value)
    yield Entry(row, "learned, of all %", n, share(row, "", world.solved("learned"), n).value)
    for planner in PLANNERS:
        one = over_optimum(world, planner)
        yield Entry(row, f"{planner} / optimum", one.n, one.value)


def _reaches_note(worlds: Sequence[World]) -> str:
    """Which worlds say little, if any."""
    easy = [f"{one.reach} {one.size} {one.percent} %" for one in worlds if one.free > 0.9]
    hard = [
        f"{one.reach} {one.size} {one.percent} %" for one in worlds if len(one.solvable) < 0.1 * len(one.rows["exact"])
    ]
    return (
        "`free at once`: random boards whose target is accessible, and which are no instances. "
        + (f"Nearly every board is free: {'; '.join(easy)}. " if easy else "Nowhere are nine in ten boards free. ")
        + (f"Nearly none can be solved: {'; '.join(hard)}." if hard else "Nowhere can fewer than one in ten be solved.")
    )
