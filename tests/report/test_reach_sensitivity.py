"""What the paper does not say of the reach: the measured rows, what the study makes of them, and the preset."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml

from dore.report import results
from dore.report.sources import paper_table, sources_of
from dore.report.study import cells_of
from scripts.program import run
from scripts.reach_sensitivity import LAYOUTS, Options, main, measures, paper
from tests.report import fakes

ROOT = Path(__file__).parents[2]
Row = dict[str, Any]


def row(obstacles: int = 3, clearance: float = 0.142, board: str = "3x6", stage: str = "grid", **off: float) -> Row:
    """A row whose optimum and baseline are the paper's, but for what is `off`."""
    made = {"stage": stage, "seed": 0, "board": board, "clearance_m": clearance, "half_fan_deg": 15.0, "n_sectors": 30}
    made |= {"corridor_m": None, "avoid_corridors": False, "obstacles": obstacles}
    made |= measures([1] * 4, [2] * 4) | paper(board, obstacles)
    dqn, baseline = made["paper_dqn_mean"], made["paper_baseline_mean"]
    return made | {
        "optimum_mean": dqn + off.get("optimum", 0),
        "optimum_high": dqn + off.get("optimum", 0) + off.get("half", 0),
        "both_optimum_mean": dqn + off.get("both", 0),
        "baseline_mean": baseline + off.get("baseline", 0),
    }


def measured(tmp_path: Path, rows: list[Row]) -> pd.DataFrame:
    """The study's points, one row per column."""
    pd.DataFrame(rows).to_csv(tmp_path / "reach_sensitivity.csv", index=False)
    return sources_of(fakes.study("reach_sensitivity"), tmp_path / "gone", tmp_path)["points"].rows


def test_a_row_counts_the_optimum_over_all_and_the_baseline_over_what_both_solve() -> None:
    one = measures([1, 3, 4, None, 2], [2, 5, None, None])
    assert (one["optimum_n"], one["optimum_solved"], one["optimum_mean"]) == (5, 0.8, 2.5)
    assert [one[name] for name in ("baseline_n", "baseline_solved", "baseline_mean")] == [4, 0.5, 3.5]
    assert one["both_optimum_mean"] == 2.0
    assert one["optimum_sd"] == pytest.approx(math.sqrt(5 / 3), abs=1e-4)
    assert math.isnan(one["baseline_low"])
    other = paper("6x6", 5)
    assert (other["paper_dqn_mean"], other["paper_baseline_sd"]) == (2.1, 0.63)


def test_distances_are_root_mean_squares_over_the_columns(tmp_path) -> None:
    found = measured(tmp_path, [row(3, optimum=0.3, baseline=-1), row(4, optimum=-0.4, both=2), row(3, board="6x6")])
    here = found[found.board == "3x6"].iloc[0]
    assert here.dqn_here == pytest.approx(math.sqrt((0.3**2 + 0.4**2) / 2))
    assert here.baseline_here == pytest.approx(math.sqrt(1 / 2))
    assert here.both_here == pytest.approx(math.sqrt(4 / 2))
    assert here.dqn == pytest.approx(math.sqrt((0.3**2 + 0.4**2) / 3))


def test_above_needs_more_than_the_interval_of_the_difference(tmp_path) -> None:
    half = math.hypot(0.2, 2.262 * 0.69 / math.sqrt(10))
    off = (half - 0.01, half + 0.01, -half - 0.01)
    rows = [row(9, r, "6x6", optimum=by, half=0.2) for r, by in enumerate(off, 1)]
    assert measured(tmp_path, rows).above.tolist() == [False, True, False]


def test_the_nearest_point_has_both_rows_near_in_units_of_the_least(tmp_path) -> None:
    """A point that no instance is left of has no rank; neither has what was measured again."""
    off = ((0.1, 4.0), (1.0, 2.0), (0.2, 2.4), (0.1, math.nan))
    points = (0.1, 0.2, 0.3, 0.4)
    rows = [row(3, point, optimum=a, baseline=b) for point, (a, b) in zip(points, off, strict=True)]
    found = measured(tmp_path, [*rows, row(3, points[1], stage="check", optimum=0.01, baseline=0.01)])
    third = found.iloc[2]
    assert third["joint"] == pytest.approx(math.sqrt((2**2 + 1.2**2) / 2))
    assert third.plain == pytest.approx(math.sqrt((0.2**2 + 2.4**2) / 2))
    assert found["rank"].fillna(0).tolist() == [1, 3, 2, 0, 0]


def measure(tmp_path: Path, *more: str) -> int:
    sizes = ["instances=5", "baseline_instances=5", "obstacles=[3,4]"]
    reaches = ["clearance=[0.106,0.142]", "fan=[30]", "corridor=[null,0.16]"]
    return run(main, Options, [f"out={tmp_path / 'grid' / 'all'}", *sizes, *reaches, *more])


def test_a_small_grid_and_its_page(tmp_path: Path) -> None:
    assert measure(tmp_path) == 0
    nearest = ["clearance=[0.142]", "corridor=[null]", "avoid=[false]", "seed=1"]
    assert measure(tmp_path, f"out={tmp_path / 'check' / 'nearest'}", *nearest) == 0
    grid = pd.read_csv(tmp_path / "grid" / "all" / "rows.csv")
    assert (len(grid), grid.n_sectors.unique().tolist()) == (2 * 2 * 2 * 2 * 2, [60])
    assert (grid.optimum_solved >= grid.baseline_solved).all()
    assert (grid.both_optimum_mean <= grid.baseline_mean).all()
    spec, docs = fakes.study("reach_sensitivity"), tmp_path / "docs"
    page = results.write_page(spec, "reach_sensitivity", tmp_path, docs).read_text(encoding="utf-8")
    assert "2 reaches x 4 corridors on 3x6 and 6x6" in page
    assert " nan" not in page
    spec["folder"] = str(tmp_path / "gone")
    assert results.write_page(spec, "reach_sensitivity", None, docs).read_text(encoding="utf-8") == page


@pytest.mark.parametrize(
    ("more", "named"),
    [
        ("baseline_instances=6", "baseline_instances: got 6, want 5 at most"),
        ("instances=0", "instances: got 0"),
        ("corridor=[-1]", "corridor_m: got -1.0, want"),
        ("corridor=[wide]", "corridor[0]: Value 'wide'"),
        ("clearance=[-1]", "clearance_m: got -1.0, want"),
        ("obstacles=[2]", "obstacles: got 2, want"),
    ],
)
def test_bad_arguments_are_one_line_and_exit_code_2(tmp_path: Path, capsys, more: str, named: str) -> None:
    assert measure(tmp_path, more) == 2
    assert named in capsys.readouterr().err.splitlines()[-1]


def test_paper_fit_is_the_nearest_point_and_is_what_was_measured_again() -> None:
    spec = fakes.study("reach_sensitivity")
    points = sources_of(spec, ROOT / "gone", ROOT / "docs/results")["points"].rows
    best, again = points[points["rank"] == 1].iloc[0], points[points.stage == "check"]
    preset = yaml.safe_load((ROOT / "conf/reach/paper_fit.yaml").read_text(encoding="utf-8"))
    assert {key: best[key] for key in ("clearance_m", "half_fan_deg", "n_sectors")}.items() <= preset.items()
    # The preset is a reach; the corridor that goes with it is the planner's default.
    baseline = yaml.safe_load((ROOT / "conf/planner/straight_line.yaml").read_text(encoding="utf-8"))
    assert (baseline["corridor_m"], baseline["avoid_corridors"]) == (None, best.avoid_corridors)
    assert math.isnan(best.corridor_m)
    assert set(again.reach + again.corridors) == {best.reach + best.corridors}
    assert spec["given"]["nearest"] == ["clearance=[0.19]", "fan=[20]", "corridor=[null]", "avoid=[false]"]
    assert best.reach == "0.19 20.0"


def test_the_presets_that_the_page_names_are_those_on_the_grid() -> None:
    points = sources_of(fakes.study("reach_sensitivity"), ROOT / "gone", ROOT / "docs/results")["points"].rows
    named = {}
    for path in (ROOT / "conf/reach").glob("*.yaml"):
        keys = yaml.safe_load(path.read_text(encoding="utf-8"))
        if set(keys) == {"_target_", "clearance_m", "half_fan_deg", "n_sectors"}:
            named[path.stem] = f"{keys['clearance_m']} {keys['half_fan_deg']}"
    shown = points[points.preset != ""]
    assert dict(zip(shown.preset, shown.reach, strict=True)) == {
        name: reach for name, reach in named.items() if reach in set(points.reach)
    }


def test_the_papers_savings_are_those_of_its_text() -> None:
    for board, saved in zip(LAYOUTS, (0.34, 0.36), strict=True):
        means = paper_table(f"rearrangements_{board}").groupby("method")["mean"].sum()
        # It may average the columns' percentages.
        assert 1 - means["dqn"] / means["baseline"] == pytest.approx(saved, abs=0.02)


def test_cells_of_the_grid_are_framed_where_the_point_is_nearest(tmp_path: Path) -> None:
    spec = fakes.study("reach_sensitivity")
    cells = cells_of(spec, sources_of(spec, ROOT / "gone", ROOT / "docs/results"))
    framed = cells[cells.metric == "nearest"]
    assert framed[["row", "column", "mean"]].to_numpy().tolist() == [["0.19", "20", 1.0]]
