"""The studies of Tables 1 to 3, of the one network and of execution times, against figures worked out by hand."""

from __future__ import annotations

import pytest
from scipy import stats

from dore.errors import InputError
from dore.report import results
from dore.report.sources import paper_table
from tests.report import fakes
from tests.report.fakes import NO_PLAN, cell, evaluation, made, rows_of, training


@pytest.fixture
def tables(tmp_path):
    """The fifth instance has no plan; transfer learning solves the fourth and fails on the sixth; two equal columns."""
    planners = {name: {"max_seconds": 60} for name in ("exact", "transfer", "graph_search")}
    for z in (3, 8):
        single = [
            *rows_of("exact", 1, 2, 2, 3, NO_PLAN, 4, z=z),
            *rows_of("straight_line", 2, 4, None, 6, None, None, z=z),
            *rows_of("learned", 1, 2, 3, None, None, None, z=z, seconds=(1, 2, 3, 6, 1, 1)),
            *rows_of("transfer", 1, 2, 3, 3, None, None, z=z, seconds=(1, 1, 1, 2, 20, 20), text="after 96 episodes"),
            *rows_of("graph_search", 1, 2, 2, 3, NO_PLAN, None, z=z, seconds=(10, 20, 30, 60, 10, 10)),
        ]
        sequential = [
            *rows_of("exact", 1, 2, 2, 3, NO_PLAN, 4, z=z),
            *rows_of("learned", 1, 3, 2, 3, None, None, z=z),
            *rows_of("guided", 1, 2, 2, 3, None, 4, z=z),
        ]
        evaluation(tmp_path / f"single/z{z}", single, planners=planners, timing="single", threads=1)
        evaluation(tmp_path / f"sequential/z{z}", sequential, planners=planners, timing="single", threads=1)
    for structure in ("single", "sequential"):
        training(tmp_path / structure / "train", (10, 1, 0.9, 1, 1), instances={"min_obstacles": 3, "max_obstacles": 7})
    return tmp_path


def test_tables_2_and_3_by_hand(tables):
    """`graph_search` gives up on the sixth instance; the first and second are solved by all."""
    cells, facts = made("table2", tables)
    planners = ["straight_line", "learned (single)", "learned (sequential)", "guided", "exact"]
    moves = cells[(cells.metric == "rearrangements") & (cells.column == "3")]
    assert list(moves["row"]) == ["paper: baseline", "paper: single DQN", "graph_search", *planners]
    for planner, mean in zip(planners, (3, 1.5, 2, 1.5, 1.5), strict=True):
        assert tuple(cell(cells, "rearrangements", planner, "3")[["n", "mean"]]) == (2, mean)
    assert tuple(cell(cells, "rearrangements", "paper: single DQN", "8")[["n", "mean", "sd"]]) == (10, 3.6, 0.96)
    saved = "rearrangements saved against straight_line (%)"
    # The single model and the baseline share two instances, the others three, the fourth among them.
    for planner, n, percent in (("learned (single)", 2, 50), ("learned (sequential)", 3, 100 * (1 - 7 / 12))):
        found = cell(cells, saved, planner, "3")
        assert (found["n"], found["mean"]) == (n, pytest.approx(percent))
    theirs = 100 * (1 - (1.4 / 2.2 + 3.6 / 5.9) / 2)
    assert cell(cells, saved, "paper: single DQN", "all")["mean"] == pytest.approx(theirs)
    over = "rearrangements / proved optimum"
    for planner, ratio in (("straight_line", 2), ("learned (single)", 1), ("learned (sequential)", 7 / 6)):
        assert cell(cells, over, planner, "3")["mean"] == pytest.approx(ratio)
    # What has no plan counts against no planner.
    for planner, percent in (("straight_line", 60), ("transfer (single)", 80), ("guided", 100)):
        assert tuple(cell(cells, "solved of the solvable (%)", planner, "3")[["n", "mean"]]) == (5, percent)
    # Two of the five that have a plan are failed, of which the fourth is then solved.
    learning = "transfer learning (TL)"
    for column, n in (("3", 1), ("all", 2)):
        assert tuple(cell(cells, learning, "learned (single) fails (%)", column)[["n", "mean"]]) == (5 * n, 40)
        assert cell(cells, learning, "TL then solves (%)", column)["mean"] == 50
        assert tuple(cell(cells, learning, "TL seconds", column)[["n", "mean"]]) == (n, 2)
        assert cell(cells, learning, "TL episodes", column)["mean"] == 96
    assert cell(cells, learning, "TL seconds, paper / ours", "all")["mean"] == 143 / 2
    assert facts["budgets"] == ["exact 60 s, transfer 60 s"]
    assert facts["trained"][0].startswith(
        "`single` DQN: trained with 3-7 obstacles, seed 0, 120 CPU s, 900 episodes of "
    )


def test_table_1_by_hand(tables):
    """Times are of all instances, also those that were given up."""
    cells, _ = made("table1", tables)
    found = cell(cells, "planning time (s)", "graph_search", "3")
    assert (found["n"], found["mean"]) == (6, 140 / 6)
    ratio = cell(cells, "planning time, graph_search / learned (single)", "ours", "3")
    assert (ratio["n"], ratio["mean"]) == (6, pytest.approx(140 / 14))
    paper = cell(cells, "planning time, graph_search / learned (single)", "paper", "3")
    assert paper["mean"] == pytest.approx(1.3 / 0.8)
    assert cell(cells, "median planning time (s)", "graph_search", "3")["mean"] == 15
    assert cell(cells, "gave up (%)", "graph_search", "3")["mean"] == pytest.approx(100 / 6)


def test_times_of_batches_are_no_planning_times(tables):
    rows = tables / "single" / "z3" / "rows.csv"
    rows.write_text(rows.read_text(encoding="utf-8").replace(",single,", ",batched,"), encoding="utf-8")
    with pytest.raises(InputError, match=r"sources.runs: timing batched, want single"):
        made("table1", tables)


def test_the_generalist_by_hand(tmp_path):
    """Five boards of each layout: the fourth has no plan, the fifth is decided by nobody."""
    for layout in ("3x6", "arc"):
        rows = [*rows_of("learned", 1, 6, None, None, None), *rows_of("exact", 1, 5, 9, NO_PLAN, None)]
        evaluation(tmp_path / "wide_hand" / layout / "all", rows)
    cells, facts = made("generalist", tmp_path)
    together, ratio = "success, layouts together (%)", "moves of the model / optimum"
    for seen in ("learned from", "never seen"):
        for needs, solved in (("1", 100), ("5-6", 100), ("7+", 0)):
            assert tuple(cell(cells, together, f"learned: {seen}", needs)[["n", "mean"]]) == (1, solved)
    assert set(cells[cells.metric == together].column) == {"1", "5-6", "7+"}
    assert cell(cells, ratio, "wide_hand, arc", "5-6")["mean"] == pytest.approx(6 / 5)
    assert (facts["n"], facts["undecided"]) == ("5", 2)
    page = results.write_page(fakes.study("generalist"), "generalist", tmp_path, tmp_path / "p").read_text("utf-8")
    assert "nan" not in page


def test_the_papers_line_of_execution_times():
    """The two constants of study=execution_time."""
    moves, seconds = (paper_table(f"{name}_3x6")["mean"] for name in ("rearrangements", "execution_time"))
    line = stats.linregress(moves, seconds)
    spec = fakes.study("execution_time")
    constants = [entry["constant"] for entry in spec["tables"][-1]["cells"] if "constant" in entry]
    assert constants == pytest.approx([line.slope, line.intercept], abs=0.05)
