"""Summaries and comparisons, against figures worked out by other means."""

from __future__ import annotations

import math

import pytest

from dore.errors import InputError
from dore.report.estimates import difference, mean, p_of_pairs, ratio, share, spread
from dore.report.evaluation import Row, Timing
from dore.report.tables import as_markdown, as_text, compare, paired_table, summarise, summary_table
from dore.world.plan import Status


def row(planner: str, instance: int, moves: int | None, planning_s: float = 0.001) -> Row:
    """A row; no moves means that the planner gave up."""
    status = Status.GAVE_UP if moves is None else Status.SOLVED
    return Row(planner, instance, 36, 5, status, "", moves or 0, planning_s, 0, Timing.SINGLE)


def test_wilson_agrees_with_published_figures() -> None:
    # Newcombe (1998), Table I, method 3: 81 of 263, 15 of 148, 0 of 20, 1 of 29.
    for successes, trials, low, high in (
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ):
        found = share(successes, trials)
        assert found.mean == successes / trials
        assert found.low == pytest.approx(low, abs=5e-5)
        assert found.high == pytest.approx(high, abs=5e-5)
    assert share(20, 20).high == 1.0
    assert math.isnan(share(0, 0).mean)


def test_mean_interval_is_students() -> None:
    found = mean([2, 4, 4, 4, 5, 5, 7, 9, 5, 5])
    # mean 5, sd 1.88562, t(9) = 2.26216.
    assert found.mean == 5
    assert found.high - 5 == pytest.approx(2.26216 * 1.885618 / math.sqrt(10), rel=1e-5)
    assert found.low == pytest.approx(10 - found.high)
    assert math.isnan(mean([1, 2, 3]).low)
    assert math.isnan(mean([]).mean)


def test_ratio_interval_is_the_ratio_estimators() -> None:
    found = ratio([2, 3, 6, 5], [1, 2, 3, 2])
    # 16 / 8; residuals 0, -1, 0, 1, whose sd is sqrt(2 / 3); t(3) = 3.18245; the base's mean is 2.
    assert found.mean == 2
    assert found.high - 2 == pytest.approx(3.18245 * math.sqrt(2 / 3) / math.sqrt(4) / 2, rel=1e-5)
    assert found.low == pytest.approx(4 - found.high)
    assert math.isnan(ratio([1, 2], [1, 2]).low)
    assert math.isnan(ratio([1, 2], [0, 0]).mean)
    assert math.isnan(ratio([], []).mean)


def test_pairs_are_compared_pair_by_pair() -> None:
    found = difference([2, 3, 5, 6], [1, 3, 4, 4])
    # The differences are 1, 0, 1, 2: mean 1, sd sqrt(2 / 3); t(3) = 3.182446.
    assert found.mean == 1
    assert found.high - 1 == pytest.approx(3.182446 * math.sqrt(2 / 3) / 2, rel=1e-6)
    # Six instances that only one planner solves, one that only the other does: 2 * (1 + 7) / 2 ** 7.
    assert p_of_pairs([1] * 6 + [0, 1, 0], [0] * 6 + [1, 1, 0]) == pytest.approx(16 / 128)
    assert p_of_pairs([1, 0], [1, 0]) == 1


def test_a_spread_leaves_out_what_is_missing() -> None:
    found = spread([1.0, math.nan, 3.0])
    assert (found.n, found.mean, found.low, found.high) == (2, 2, 1, 3)
    assert math.isnan(spread([math.nan]).mean)


def test_a_summary_counts_moves_of_solved_instances_only() -> None:
    rows = [row("a", 1, 2), row("a", 2, 4), row("a", 3, None, 0.101), row("a", 4, 6)]
    (one,) = summarise(rows)
    assert (one.instances, one.solved, one.success.mean) == (4, 3, 0.75)
    assert (one.moves.mean, one.moves_sd) == (4, 2)
    assert one.planning_p50_ms == pytest.approx(1.0)
    assert one.planning_p99_ms == pytest.approx(98.0)


def test_what_one_planner_proves_unsolvable_counts_against_none() -> None:
    proof = Row("exact", 2, 36, 5, Status.UNSOLVABLE, "", 0, 0.0, 9, Timing.SINGLE)
    rows = [row("a", 1, 2), row("a", 2, None), row("exact", 1, 1), proof]
    first, _ = summarise(rows)
    assert (first.success.mean, first.success_of_solvable.mean) == (0.5, 1.0)


def test_success_of_solvable_is_not_told_while_an_instance_is_undecided() -> None:
    first, second = summarise([row("a", 1, 2), row("a", 2, None), row("b", 1, 1), row("b", 2, None)])
    assert math.isnan(first.success_of_solvable.mean)
    first, second = summarise([row("a", 1, 2), row("a", 2, None), row("b", 1, 1), row("b", 2, 3)])
    assert (first.success_of_solvable.mean, second.success_of_solvable.mean) == (0.5, 1.0)


def test_a_comparison_uses_the_instances_that_all_solved() -> None:
    rows = [row("a", n, moves) for n, moves in enumerate([1, 2, 3, 2, None], 1)]
    rows += [row("b", n, moves) for n, moves in enumerate([2, 4, 4, None, 9], 1)]
    mine, reference = compare(rows)
    assert (mine.planner, mine.reference, mine.instances) == ("a", "b", 3)
    assert mine.moves.mean == 2
    assert mine.difference.mean == pytest.approx(-4 / 3)
    assert mine.change_percent == pytest.approx(-40.0)
    assert reference.difference.mean == 0
    assert mine.ratio.mean == pytest.approx(0.6)
    assert compare(rows, reference="a")[1].change_percent == pytest.approx(100 * (10 / 6 - 1))


def test_nothing_solved_by_all_is_a_dash_and_no_crash() -> None:
    rows = [row("a", 1, None), row("b", 1, None)]
    assert paired_table(compare(rows))[1] == ["a", "0", "-", "-", "-", ""]
    assert summary_table(summarise(rows))[1][4:6] == ["-", "-"]


def test_text_is_aligned_and_markdown_has_every_column() -> None:
    table = summary_table(summarise([row("a", n, n) for n in range(1, 6)] + [row("long_name", 1, 3)][:0]))
    lines = as_text(table).split("\n")
    assert len({len(line) for line in lines}) == 1
    assert "100.0 [56.6, 100.0]" in lines[2]
    assert {line.count("|") for line in as_markdown(table).split("\n")} == {len(table[0]) + 1}


@pytest.mark.parametrize(
    ("rows", "why"),
    [
        ([], "got none"),
        ([row("a", 1, 1), row("a", 1, 2)], "two rows of instance 1"),
        ([row("a", 1, 1), row("b", 2, 1)], "different instances"),
    ],
)
def test_rows_that_cannot_be_compared_are_refused(rows: list[Row], why: str) -> None:
    with pytest.raises(InputError, match=why):
        summarise(rows)


def test_an_unknown_reference_is_refused() -> None:
    with pytest.raises(InputError, match="want one of a"):
        compare([row("a", 1, 1)], reference="b")
