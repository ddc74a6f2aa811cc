"""Tables 1 to 3: figures worked out by hand from a few rows, and what is refused."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import pytest

from dore.errors import InputError
from dore.report.evaluation import Row, Timing
from dore.world.plan import Status
from scripts.paper_entries import Entry, Metric, means_over_columns
from scripts.paper_metrics import (
    GAVE_UP,
    LEARNING,
    MEDIAN,
    MOVES,
    OVER,
    SAVED,
    SOLVED,
    SPEEDUP,
    TIME,
    Columns,
    table_1,
    table_2_or_3,
)
from scripts.paper_runs import merged

NO_PLAN = -1


def rows_of(planner: str, *moves: int | None, seconds: Sequence[float] = (0.5,) * 9, z: int = 3) -> list[Row]:
    """A row an instance: its moves, None for a planner that gave up, NO_PLAN for a proof that there is no plan."""
    status = {None: Status.GAVE_UP, NO_PLAN: Status.UNSOLVABLE}
    return [
        Row(planner, n, 18, z, status.get(m, Status.SOLVED), "", max(m or 0, 0), seconds[n - 1], 0, Timing.SINGLE)
        for n, m in enumerate(moves, 1)
    ]


def single(z: int = 3) -> list[Row]:
    """The fifth instance has no plan; transfer learning mends the fourth and fails the sixth."""
    rows = rows_of("exact", 1, 2, 2, 3, NO_PLAN, 4, z=z)
    rows += rows_of("straight_line", 2, 4, None, 6, None, None, z=z)
    rows += rows_of("learned", 1, 2, 3, None, None, None, z=z)
    *first, fourth, fifth, sixth = rows_of("transfer", 1, 2, 3, 3, None, None, z=z)
    fourth = replace(fourth, reason="after 96 episodes", planning_s=2.0)
    fifth, sixth = (replace(row, reason="move budget after 20000 episodes", planning_s=20.0) for row in (fifth, sixth))
    return [*rows, *first, fourth, fifth, sixth]


def sequential(z: int = 3) -> list[Row]:
    rows = rows_of("exact", 1, 2, 2, 3, NO_PLAN, 4, z=z) + rows_of("learned", 1, 3, 2, 3, None, None, z=z)
    return rows + rows_of("guided", 1, 2, 2, 3, None, 4, z=z)


COLUMNS: Columns = {z: merged(single(z), sequential(z)) for z in (3, 8)}


def entry(metrics: list[Metric], name: str, row: str, column: str = "3") -> Entry:
    """The one cell of that name."""
    (found,) = [
        one
        for metric in metrics
        if metric.name == name
        for one in metric.entries
        if (one.row, one.column) == (row, column)
    ]
    return found


def test_both_models_rows_are_one_set() -> None:
    planners = dict.fromkeys(row.planner for row in COLUMNS[3])
    assert list(planners) == [
        "straight_line",
        "learned (single)",
        "transfer (single)",
        "learned (sequential)",
        "guided",
        "exact",
    ]
    assert len(COLUMNS[3]) == 6 * 6


def test_rearrangements_are_of_what_every_planner_solved() -> None:
    """The first and the second instance."""
    metrics = table_2_or_3(COLUMNS, "3x6")
    for row, value, sd in (
        ("straight_line", 3.0, math.sqrt(2)),
        ("learned (single)", 1.5, math.sqrt(0.5)),
        ("learned (sequential)", 2.0, math.sqrt(2)),
        ("guided", 1.5, math.sqrt(0.5)),
        ("exact", 1.5, math.sqrt(0.5)),
    ):
        found = entry(metrics, MOVES, row)
        assert (found.n, found.value.value) == (2, value)
        assert found.sd == pytest.approx(sd)
    assert entry(metrics, MOVES, "paper: single DQN", "8").value.value == 3.6
    assert entry(metrics, MOVES, "paper: single DQN", "8").sd == 0.96


def test_what_is_saved_is_of_the_pairs() -> None:
    """The single model and the baseline share two instances, the others three, the fourth among them."""
    metrics = table_2_or_3(COLUMNS, "3x6")
    for row, n, percent in (
        ("learned (single)", 2, 50.0),
        ("learned (sequential)", 3, 100 * (1 - 7 / 12)),
        ("guided", 3, 50.0),
        ("exact", 3, 50.0),
        ("paper: single DQN", 10, 100 * (1 - 1.4 / 2.2)),
    ):
        found = entry(metrics, SAVED, row)
        assert (found.n, found.value.value) == (n, pytest.approx(percent))
    theirs = 100 * (1 - (1.4 / 2.2 + 3.6 / 5.9) / 2)
    assert entry(metrics, SAVED, "paper: single DQN", "all").value.value == pytest.approx(theirs)
    assert entry(metrics, OVER, "straight_line").value.value == 2.0
    assert entry(metrics, OVER, "learned (single)").value.value == 1.0
    assert entry(metrics, OVER, "learned (sequential)").value.value == pytest.approx(7 / 6)


def test_what_has_no_plan_counts_against_none() -> None:
    metrics = table_2_or_3(COLUMNS, "3x6")
    for row, percent in (("straight_line", 60), ("learned (single)", 60), ("transfer (single)", 80), ("guided", 100)):
        found = entry(metrics, SOLVED, row)
        assert (found.n, found.value.value) == (5, pytest.approx(percent))


def test_transfer_learning_is_of_what_the_single_model_fails() -> None:
    """Two of the five that have a plan, of which the fourth is solved; both columns are alike."""
    metrics = table_2_or_3(COLUMNS, "3x6")
    for column, n in (("3", 1), ("all", 2)):
        assert entry(metrics, LEARNING, "learned (single) fails (%)", column).value.value == pytest.approx(40)
        assert entry(metrics, LEARNING, "learned (single) fails (%)", column).n == 5 * n
        assert entry(metrics, LEARNING, "TL then solves (%)", column).value.value == pytest.approx(50)
        assert entry(metrics, LEARNING, "TL seconds", column).n == n
        assert entry(metrics, LEARNING, "TL seconds", column).value.value == 2.0
        assert entry(metrics, LEARNING, "TL episodes", column).value.value == 96
    assert entry(metrics, LEARNING, "TL seconds, paper / ours", "all").value.value == 143 / 2
    assert entry(table_2_or_3(COLUMNS, "6x6"), LEARNING, "paper: TL seconds", "all").sd == 51.4


def test_planning_time_is_of_all_instances() -> None:
    """Also those that were given up; the ratio is of the means, and steady where the times go together."""
    slow, fast = (10.0, 20.0, 30.0, 60.0), (1.0, 2.0, 3.0, 6.0)
    of_single = rows_of("exact", 1, 1, 1, 2) + rows_of("graph_search", 1, 1, 1, None, seconds=slow)
    of_single += rows_of("learned", 1, 1, 1, None, seconds=fast)
    metrics = table_1({3: merged(of_single, rows_of("exact", 1, 1, 1, 2))})
    found = entry(metrics, TIME, "graph_search")
    assert (found.n, found.value.value) == (4, 30.0)
    # sd = sqrt((400 + 100 + 0 + 900) / 3), t(3) = 3.18245.
    assert found.sd == pytest.approx(math.sqrt(1400 / 3))
    assert found.value.high - 30 == pytest.approx(3.18245 * math.sqrt(1400 / 3) / 2, rel=0.01)
    ratio = entry(metrics, SPEEDUP, "ours").value
    assert (ratio.low, ratio.value, ratio.high) == pytest.approx((10, 10, 10))
    assert entry(metrics, SPEEDUP, "paper").value.value == pytest.approx(1.3 / 0.8)
    assert entry(metrics, MEDIAN, "graph_search").value.value == 25
    assert entry(metrics, GAVE_UP, "graph_search").value.value == 25


def test_the_mean_of_columns_has_the_error_of_independent_ones() -> None:
    both = [one for metric in table_2_or_3(COLUMNS, "3x6") for one in metric.entries if metric.name == SOLVED]
    one = entry(table_2_or_3(COLUMNS, "3x6"), SOLVED, "straight_line").value
    mean = next(found for found in means_over_columns(both) if found.row == "straight_line")
    assert (mean.n, mean.value.value) == (10, pytest.approx(60))
    assert mean.value.high - mean.value.low == pytest.approx((one.high - one.low) / math.sqrt(2))


@pytest.mark.parametrize(
    ("other", "says"),
    [
        (rows_of("exact", 1, 2, 2, 3, NO_PLAN, 5), "instance 6 is solved with 4 moves"),
        (rows_of("exact", 1, 2, 2, 3, 3, 4), "instance 5 is unsolvable with 0 moves"),
        (rows_of("exact", 1, 2, 2, 3, NO_PLAN, 4, z=4), r"instance 1 is .*\(3 obstacles\) and .*\(4 obstacles\)"),
        (rows_of("exact", 1, 2, 2, 3, NO_PLAN), "exact has 6 and 5 instances"),
        ([], "exact has 6 and 0 instances"),
    ],
)
def test_other_instances_are_refused(other: list[Row], says: str) -> None:
    with pytest.raises(InputError, match=says) as error:
        merged(single(), other)
    assert "\n" not in str(error.value)


def test_what_exact_gave_up_once_is_no_contradiction() -> None:
    assert len(merged(single(), rows_of("exact", 1, 2, 2, 3, NO_PLAN, None))) == 24


def without(planner: str) -> Columns:
    return {3: [row for row in COLUMNS[3] if row.planner != planner]}


@pytest.mark.parametrize(
    ("columns", "says"),
    [
        (without("transfer (single)"), r"none of transfer \(single\)"),
        (without("learned (single)"), r"none of learned \(single\)"),
        (without("straight_line"), "got 'straight_line', want one of"),
        (without("exact"), "got 'exact', want one of"),
        ({3: [replace(row, reason="") for row in COLUMNS[3]]}, r"transfer \(single\), instance 4: reason ''"),
        ({3: COLUMNS[3][1:]}, "run on different instances"),
    ],
)
def test_rows_that_lack_something_are_refused(columns: Columns, says: str) -> None:
    with pytest.raises(InputError, match=says):
        table_2_or_3(columns, "3x6")


def test_times_of_batches_are_no_planning_times() -> None:
    batched = {3: [replace(row, timing=Timing.BATCHED) for row in COLUMNS[3]]}
    with pytest.raises(InputError, match="timing of those with 3 obstacles, want single"):
        table_1(batched)
    with pytest.raises(InputError, match="none of graph_search"):
        table_1(COLUMNS)
