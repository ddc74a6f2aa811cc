"""The studies of conf/study: the pages in the repository are what they make of the committed cells; Table 4 by hand."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import pytest

from dore.errors import InputError
from dore.report import results, runs
from tests.report import fakes
from tests.report.fakes import NO_PLAN, cell, evaluation, made, rows_of, training

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


@pytest.fixture
def table4(tmp_path):
    """Five instances: the fourth has no plan, the fifth is proved by none, but one planner solves it."""
    test = tmp_path / "test" / COLUMN
    chance = rows_of("random", 3, None, None, None, None)
    evaluation(test / "without", [*rows_of("exact", 1, 2, 2, NO_PLAN, None), *chance])
    evaluation(test / "single", rows_of("learned", 1, None, None, None, None))
    evaluation(test / "seed0", rows_of("learned", 1, 3, 2, None, None))
    evaluation(test / "seed1", rows_of("learned", 1, 2, 2, None, 4))
    model = [*rows_of("learned", 1, 2, None, None, None), *rows_of("refined", 1, 2, 2, None, 3)]
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
        ("shipped: learned", 4, 50),
        ("shipped: refined", 4, 100),
        ("random", 4, 25),
        ("paper: S-DQN", math.nan, 78),
        ("of all instances, solvable", 5, 80),
    ):
        found = cell(cells, success, row, COLUMN)
        assert found["n"] == n or math.isnan(n), row
        assert found["mean"] == percent, row
    assert tuple(cell(cells, success, ours, COLUMN)[["low", "high"]]) == (75, 100)
    # The fifth instance has a plan, but no optimum to compare it with.
    assert cell(cells, ratio, ours, COLUMN)["mean"] == pytest.approx((6 / 5 + 1) / 2)
    assert cell(cells, ratio, "shipped: refined", COLUMN).n == 3
    assert cell(cells, ratio, "proved optimum, rearrangements", COLUMN)["mean"] == pytest.approx(5 / 3)
    sooner = "episodes to 95 % IPT"
    assert cell(cells, sooner, "literal: S-DQN", COLUMN)["mean"] == 400
    assert cell(cells, sooner, "literal S-DQN / improved", COLUMN)["mean"] == 400 / 20
    assert cell(cells, sooner, "literal SS-DQN / improved, more than", COLUMN)["mean"] == 300 / 20
    assert cell(cells, "CPU seconds to 95 % IPT", ours, COLUMN)["mean"] == 2
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
    """By hand: with seed 0 `heads` wins one of 4 boards and loses one, with seed 1 it loses one.

    Where both solve it makes 9 moves to 5.
    """
    plans = {
        "none_seed0": (1, 1, 1, None),
        "none_seed1": (1, 1, 1, 1),
        "heads_seed0": (2, 2, None, 1),
        "heads_seed1": (1, 1, 3, None),
    }
    for name, moves in plans.items():
        heads = "mean" if name.startswith("heads") else "independent"
        training(tmp_path / f"trained/improved_single_{name}", (10, 1, 0.5, 1, 2), agent={"heads": heads})
        evaluation(tmp_path / f"tested/improved_single_{name}", rows_of("learned", *moves))
    cells, facts = made("ablation", tmp_path)
    form = "from the improved form"
    assert tuple(cell(cells, form, "single: unchanged", "success (%)")[["mean", "low", "high"]]) == (87.5, 75, 100)
    assert cell(cells, form, "single: heads", "success (%)")["mean"] == 75
    found = cell(cells, form, "single: heads", "minus unchanged, points")
    assert tuple(found[["mean", "low", "high"]]) == (-12.5, -25, 0)
    assert cell(cells, form, "single: heads", "moves / unchanged")["mean"] == pytest.approx(9 / 5)
    assert set(cells[cells.column == "minus unchanged, points"]["row"]) == {"single: heads"}
    assert facts["changes"] == ["improved, single, heads: `agent.heads: independent -> mean`"]
    for run in tmp_path.glob("trained/improved_single_none*"):
        shutil.rmtree(run)
    with pytest.raises(InputError, match="improved, single, heads: no run to compare it with"):
        made("ablation", tmp_path)
