"""Summaries and comparisons, against figures worked out by other means."""

from __future__ import annotations

import math
import re

import pytest

from dore.errors import InputError
from dore.report.estimates import proportion, ratio_of_means, sample_mean, spread
from dore.report.tables import evaluation_tables
from tests.report.fakes import NO_PLAN, evaluation, rows_of


def test_wilson_agrees_with_published_figures() -> None:
    # Newcombe (1998), Table I, method 3: 81 of 263, 15 of 148, 0 of 20, 1 of 29.
    for successes, trials, low, high in (
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ):
        found = proportion(successes, trials)
        assert found.mean == successes / trials
        assert found.low == pytest.approx(low, abs=5e-5)
        assert found.high == pytest.approx(high, abs=5e-5)
    assert proportion(20, 20).high == 1.0
    assert math.isnan(proportion(0, 0).mean)


def test_mean_interval_is_students() -> None:
    found = sample_mean([2, 4, 4, 4, 5, 5, 7, 9, 5, 5])
    # mean 5, sd 1.88562, t(9) = 2.26216.
    assert found.mean == 5
    assert found.high - 5 == pytest.approx(2.26216 * 1.885618 / math.sqrt(10), rel=1e-5)
    assert found.low == pytest.approx(10 - found.high)
    assert math.isnan(sample_mean([1, 2, 3]).low)
    assert math.isnan(sample_mean([]).mean)


def test_ratio_interval_is_the_ratio_estimators() -> None:
    found = ratio_of_means([2, 3, 6, 5], [1, 2, 3, 2])
    # 16 / 8; residuals 0, -1, 0, 1, whose sd is sqrt(2 / 3); t(3) = 3.18245; the base's mean is 2.
    assert found.mean == 2
    assert found.high - 2 == pytest.approx(3.18245 * math.sqrt(2 / 3) / math.sqrt(4) / 2, rel=1e-5)
    assert found.low == pytest.approx(4 - found.high)
    assert math.isnan(ratio_of_means([1, 2], [1, 2]).low)
    assert math.isnan(ratio_of_means([1, 2], [0, 0]).mean)
    assert math.isnan(ratio_of_means([], []).mean)


def test_a_spread_leaves_out_what_is_missing() -> None:
    found = spread([1.0, math.nan, 3.0])
    assert (found.n, found.mean, found.low, found.high) == (2, 2, 1, 3)
    assert math.isnan(spread([math.nan]).mean)


def printed(folder, *planners) -> list[list[str]]:
    """What dore-evaluate prints of rows, split at two or more blanks."""
    evaluation(folder, [row for rows in planners for row in rows])
    lines = evaluation_tables(folder).splitlines()
    return [re.split(r"\s{2,}", line) for line in lines if line and not line.startswith("--")]


def test_a_summary_counts_moves_of_solved_instances_only(tmp_path) -> None:
    head, one = printed(tmp_path / "a", rows_of("a", 2, 4, None, 6, seconds=(0.001, 0.001, 0.101, 0.001)))
    assert dict(zip(head, one, strict=True)) == {
        "planner": "a",
        "instances": "4",
        "solved %": "75.0 [30.1, 95.4]",
        "of solvable %": "-",
        "rearrangements": "4.00",
        "sd": "2.00",
        "p50 ms": "1.00",
        "p99 ms": "98.00",
        "timing": "single",
    }


def test_what_one_planner_proves_unsolvable_counts_against_none(tmp_path) -> None:
    _, first, *_ = printed(tmp_path / "a", rows_of("a", 2, None), rows_of("exact", 1, NO_PLAN))
    assert first[2:4] == ["50.0 [9.5, 90.5]", "100.0 [20.7, 100.0]"]


def test_success_of_solvable_is_not_given_while_an_instance_is_undecided(tmp_path) -> None:
    _, first, second, *_ = printed(tmp_path / "a", rows_of("a", 2, None), rows_of("b", 1, None))
    assert first[3] == second[3] == "-"
    _, first, second, *_ = printed(tmp_path / "b", rows_of("a", 2, None), rows_of("b", 1, 3))
    assert (first[3][:4], second[3][:5]) == ("50.0", "100.0")


def test_a_comparison_uses_the_instances_that_all_solved(tmp_path) -> None:
    head, mine, reference = printed(tmp_path / "a", rows_of("a", 1, 2, 3, 2, None), rows_of("b", 2, 4, 4, None, 9))[3:]
    assert head == ["planner", "solved by all", "rearrangements", "sd", "less b", "change %"]
    assert mine == ["a", "3", "2.00", "1.00", "-1.33", "-40.0"]
    assert reference == ["b", "3", "3.33", "1.15", "-", "-"]


def test_differences_have_their_interval(tmp_path) -> None:
    _, mine, _ = printed(tmp_path / "a", rows_of("a", 2, 3, 5, 6), rows_of("b", 1, 3, 4, 4))[3:]
    half = 3.182446 * math.sqrt(2 / 3) / 2
    assert mine[4] == f"1.00 [{1 - half:.2f}, {1 + half:.2f}]"


def test_nothing_solved_by_all_is_a_dash_and_no_crash(tmp_path) -> None:
    lines = printed(tmp_path / "a", rows_of("a", None), rows_of("b", None))
    assert lines[1][4:6] == ["-", "-"]
    assert lines[4][:2] == ["a", "0"]
    assert set(lines[4][2:]) <= {"-"}


def test_text_is_aligned(tmp_path) -> None:
    evaluation(tmp_path / "a", [*rows_of("a", 1, 2, 3, 4, 5), *rows_of("long_name", 1, 2, 3, 4, 5)])
    first, second = evaluation_tables(tmp_path / "a").split("\n\n")
    assert len({len(line) for line in first.splitlines()}) == 1
    assert len({len(line) for line in second.splitlines()}) == 1
    assert "100.0 [56.6, 100.0]" in first


@pytest.mark.parametrize(
    ("rows", "why"),
    [
        ([], "no planner, want the same instances"),
        ([*rows_of("a", 1), *rows_of("a", 2)], "two rows of instance 1"),
        ([*rows_of("a", 1), *rows_of("b", 1, 2)], "rows of a, b, want the same instances of each"),
    ],
)
def test_rows_that_cannot_be_compared_are_refused(tmp_path, rows, why) -> None:
    evaluation(tmp_path / "a", rows)
    with pytest.raises(InputError, match=why):
        evaluation_tables(tmp_path / "a")
