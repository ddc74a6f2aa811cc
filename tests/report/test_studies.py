"""The studies of conf/study: the pages in the repository are what they make of the committed cells; figures by hand."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import pandas as pd
import pytest
from scipy import stats

from dore.errors import InputError
from dore.report import results, runs
from dore.report.facts import facts_of
from dore.report.sources import paper_table, sources_of
from dore.report.study import cells_of
from tests.report import fakes
from tests.report.fakes import NO_PLAN, evaluation, rows_of, training

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "docs" / "results"
NAMES = sorted(path.stem for path in (ROOT / "conf" / "study").glob("*.yaml") if not path.stem.startswith("_"))
COLUMN = "6x6_z3-8"


@pytest.mark.parametrize("name", NAMES)
def test_the_page_is_what_the_study_makes_of_the_committed_cells(name, tmp_path):
    for path in RESULTS.glob("*"):
        if path.suffix in (".csv", ".json"):
            shutil.copy(path, tmp_path)
        elif path.is_dir():
            shutil.copytree(path, tmp_path / path.name)
    spec = fakes.study(name) | {"folder": str(tmp_path / "no_runs")}
    page = results.write_page(spec, name, None, tmp_path).read_text(encoding="utf-8")
    assert page == (RESULTS / f"{name}.md").read_text(encoding="utf-8"), f"dore-report study={name} makes it again"
    for one in spec.get("figures", []):
        assert (RESULTS / one["file"]).read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("name", NAMES)
def test_every_run_of_a_study_can_be_named(name, tmp_path):
    jobs = [job for some in runs.jobs_of(fakes.study(name), tmp_path) for job in some]
    assert len({job.makes for job in jobs}) == len(jobs), "two runs in one folder"
    assert not any("{" in word for job in jobs for word in job.command()[3:])


def cell(cells: pd.DataFrame, metric: str, row: str, column: str) -> pd.Series:
    """The one cell of that name."""
    found = cells[(cells.metric == metric) & (cells["row"] == row) & (cells.column == column)]
    assert len(found) == 1, f"{metric}, {row}, {column}: {len(found)} cells"
    return found.iloc[0]


def made(name: str, root: Path) -> tuple[pd.DataFrame, dict[str, object]]:
    spec = fakes.study(name)
    sources = sources_of(spec, root, root)
    return cells_of(spec, sources), facts_of(spec, sources)


@pytest.fixture
def table4(tmp_path):
    """Five instances: the fourth has no plan, the fifth is proved by none, but solved by the guided search."""
    test = tmp_path / "test" / COLUMN
    evaluation(test / "exact", rows_of("exact", 1, 2, 2, NO_PLAN, None))
    evaluation(test / "single", rows_of("learned", 1, None, None, None, None))
    evaluation(test / "seed0", rows_of("learned", 1, 3, 2, None, None))
    evaluation(test / "seed1", rows_of("learned", 1, 2, 2, None, 4))
    model = [*rows_of("learned", 1, 2, None, None, None), *rows_of("guided", 1, 2, 2, None, 3)]
    evaluation(test / "generalist", model)
    copies = {"target_update": {"value_network_update_interval": 9}}
    training(tmp_path / f"literal/single_{COLUMN}", (100, 10, 0.5, 5, 1), (400, 40, 0.95, 20, 1), **copies)
    training(tmp_path / f"literal/sequential_{COLUMN}", (100, 10, 0.5, 5, 1), (300, 30, 0.9, 15, 1), **copies)
    for kind in ("improved", "sooner"):
        training(tmp_path / f"{kind}/seed0_{COLUMN}", (10, 1, 0.96, 1, 1), done={"episodes": 20})
        training(tmp_path / f"{kind}/seed1_{COLUMN}", (10, 1, 0.9, 1, 1), (30, 3, 0.97, 3, 1), done={"episodes": 40})
    return tmp_path


def test_table_4_by_hand(table4):
    cells, facts = made("table4", table4)
    success, ratio, ours = "success of the solvable (%)", "rearrangements / proved optimum", "improved, over seeds"
    for row, n, percent in (
        ("literal: S-DQN", 4, 25),
        (ours, 2, (75 + 100) / 2),
        ("generalist", 4, 50),
        ("generalist, guided", 4, 100),
        ("paper: S-DQN", math.nan, 78),
        ("of all instances, solvable", 5, 80),
    ):
        found = cell(cells, success, row, COLUMN)
        assert found["n"] == n or math.isnan(n), row
        assert found["mean"] == percent, row
    assert tuple(cell(cells, success, ours, COLUMN)[["low", "high"]]) == (75, 100)
    # The fifth instance has a plan, but no optimum to compare it with.
    assert cell(cells, ratio, ours, COLUMN)["mean"] == pytest.approx((6 / 5 + 1) / 2)
    assert cell(cells, ratio, "generalist, guided", COLUMN).n == 3
    assert cell(cells, ratio, "proved optimum, rearrangements", COLUMN)["mean"] == pytest.approx(5 / 3)
    sooner = "episodes to 95 % IPT"
    assert cell(cells, sooner, "literal: S-DQN", COLUMN)["mean"] == 400
    assert cell(cells, sooner, "literal S-DQN / improved", COLUMN)["mean"] == 400 / 20
    assert cell(cells, sooner, "literal SS-DQN / improved, more than", COLUMN)["mean"] == 300 / 20
    assert cell(cells, "seconds to 95 % IPT", ours, COLUMN)["mean"] == 2
    went = "how far the literal runs went"
    assert cell(cells, went, "S-DQN: of T_lim (%)", COLUMN)["mean"] == 50
    assert cell(cells, went, "S-DQN: best IPT before targets are first copied (%)", COLUMN)["mean"] == 50
    assert list(cells[cells.metric == went]["row"].str[:5].unique()) == ["S-DQN", "SS-DQ"]
    ends = cell(cells, "how what is not solved ends (%)", "literal: S-DQN: move budget", COLUMN)
    assert (ends["n"], ends["mean"]) == (5, 80)
    assert (facts["undecided"], facts["instances"], facts["commit"]) == (0, "5", "abc1234")


def test_a_page_of_runs_then_of_its_own_cells(table4, tmp_path):
    """Without the runs the page says the same."""
    spec = fakes.study("table4")
    pages = tmp_path / "pages"
    first = results.write_page(spec, "table4", table4, pages).read_text(encoding="utf-8")
    assert "| paper: S-DQN | 78 |" in first
    assert "| literal: SS-DQN | - |" in first
    assert (pages / "table4.png").stat().st_size > 10_000
    spec["folder"] = str(tmp_path / "gone")
    assert results.write_page(spec, "table4", None, pages).read_text(encoding="utf-8") == first


def test_evaluations_of_other_instances_are_refused(table4):
    config = table4 / "test" / COLUMN / "seed0" / "config.yaml"
    config.write_text(config.read_text(encoding="utf-8").replace("0.142", "0.15"), encoding="utf-8")
    with pytest.raises(InputError, match=r"reach.clearance_m is 0.142 and 0.15, want the same instances"):
        made("table4", table4)


def test_two_proofs_that_disagree_are_refused(table4):
    evaluation(table4 / "test" / COLUMN / "again", rows_of("exact", 1, 2, 3, NO_PLAN, None))
    with pytest.raises(InputError, match=r"instance 3 of .*two proofs disagree"):
        made("table4", table4)


def test_the_ablation_by_hand(tmp_path):
    training(tmp_path / "improved_single_none_seed0", (10, 1, 0.96, 1, 2), agent={"heads": "independent"})
    training(
        tmp_path / "improved_single_none_seed1", (10, 1, 0.5, 1, 2), (30, 4, 1, 1, 3), agent={"heads": "independent"}
    )
    training(tmp_path / "improved_single_heads_seed0", (10, 1, 0.5, 1, 2), agent={"heads": "mean"})
    training(tmp_path / "improved_single_heads_seed1", (10, 1, 0.7, 1, 2), agent={"heads": "mean"})
    cells, facts = made("ablation", tmp_path)
    form, end = "from the improved form", "IPT at the end (%)"
    assert tuple(cell(cells, form, "single: unchanged", end)[["n", "mean", "low", "high"]]) == (2, 98, 96, 100)
    assert cell(cells, form, "single: heads", end)["mean"] == pytest.approx(60)
    assert cell(cells, form, "single: heads", "less unchanged")["mean"] == pytest.approx(-38)
    assert cell(cells, form, "single: unchanged", "episodes to 95 % IPT")["mean"] == 20
    assert set(cells[cells.column == "less unchanged"]["row"]) == {"single: heads"}
    assert facts["changes"] == ["improved, single, heads: `agent.heads: independent -> mean`"]
    for run in tmp_path.glob("improved_single_none*"):
        shutil.rmtree(run)
    with pytest.raises(InputError, match="improved, single, heads: no run to compare it with"):
        made("ablation", tmp_path)


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
    assert facts["trained"][0].startswith("`single` DQN: trained with 3-7 obstacles, seed 0, 120 s, 900 episodes")


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
    rows.write_text(rows.read_text(encoding="utf-8").replace(",single\n", ",batched\n"), encoding="utf-8")
    with pytest.raises(InputError, match=r"sources.runs: timing batched, want single"):
        made("table1", tables)


def test_the_generalist_by_hand(tmp_path):
    """Five instances of each world: the fourth has no plan, the fifth is decided by nobody."""
    model = [*rows_of("learned", 1, 3, None, None, None), *rows_of("guided", 1, 2, 2, None, None)]
    for reach, board, percent, n, cell_m in (
        ("wide_hand", "6x6", 20, 7, 0.12),
        ("wide_hand", "6x6", 30, 11, 0.12),
        ("wide_hand", "10x10", 20, 20, 0.09),
        ("published", "6x6", 20, 7, 0.12),
        ("panda_slim", "6x6", 20, 7, 0.12),
    ):
        side = int(board.partition("x")[0])
        layout = {
            "_target_": "dore.world.layout.Layout.grid",
            "rows": side,
            "cols": side,
            "cell_m": cell_m,
            "front_m": 0.4,
        }
        config = {
            "layout": layout,
            "reach": {
                "_target_": "dore.world.reach.Reach",
                "clearance_m": 0.106,
                "half_fan_deg": 30.0,
                "n_sectors": 60,
            },
            "instances": {"seed": 0, "min_obstacles": n, "max_obstacles": n},
            "model": "weights",
        }
        world = tmp_path / reach / f"{board}_{percent}"
        evaluation(world / "exact", rows_of("exact", 1, 2, 2, NO_PLAN, None), **config)
        evaluation(world / "model", model, **config)
    cells, facts = made("generalist", tmp_path)
    success, of_all, ratio = "success of the solvable (%)", "of all instances (%)", "rearrangements / proved optimum"
    assert tuple(cell(cells, success, "6 x 6, learned", "20 %")[["n", "mean"]]) == (3, pytest.approx(200 / 3))
    assert cell(cells, success, "6 x 6, guided", "30 %")["mean"] == 100
    for row, percent in (("learned", 40), ("solvable", 60), ("undecided", 20)):
        assert cell(cells, of_all, f"6 x 6, {row}", "20 %")["mean"] == pytest.approx(percent)
    assert tuple(cell(cells, ratio, "6 x 6, learned", "20 %")[["n", "mean"]]) == (2, pytest.approx(4 / 3))
    assert cell(cells, ratio, "6 x 6, proved optimum", "20 %")["mean"] == pytest.approx(5 / 3)
    rows = ["6 x 6, learned", "6 x 6, guided", "6 x 6, solvable", "6 x 6, undecided", "10 x 10, 9 cm, learned"]
    assert list(dict.fromkeys(cells[cells.metric == of_all]["row"]))[:5] == rows
    for column, n in (("learned from", 3), ("its reach, but never this size or density", 9), ("never this reach", 3)):
        assert cell(cells, "together (%)", "guided", column)["n"] == n
    assert 50 < cell(cells, "other reaches", "published, 6 x 6, 20 %", "free at once %")["mean"] < 90
    known = cells[(cells.metric == "learned from") & (cells["mean"] == 1)]
    assert set(known["row"]) == {"wide_hand, 6 x 6"}
    assert (facts["undecided"], facts["all"], facts["model"]) == (5, 25, "weights")
    page = results.write_page(fakes.study("generalist"), "generalist", tmp_path, tmp_path / "p").read_text(
        encoding="utf-8"
    )
    assert "| 6 x 6, learned | 66.7 [20.8, 93.9] \\* | 66.7 [20.8, 93.9] |" in page
    assert "nan" not in page


def test_the_papers_line_of_execution_times():
    """The two constants of study=execution_time."""
    moves, seconds = (paper_table(f"{name}_3x6")["mean"] for name in ("rearrangements", "execution_time"))
    line = stats.linregress(moves, seconds)
    spec = fakes.study("execution_time")
    constants = [entry["constant"] for entry in spec["tables"][-1]["cells"] if "constant" in entry]
    assert constants == pytest.approx([line.slope, line.intercept], abs=0.05)
