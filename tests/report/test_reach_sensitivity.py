"""The study of what the paper does not say: its distances, its page from the CSV alone, and its preset."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from dore.errors import InputError
from scripts.paper_rows import OBSTACLES, REARRANGEMENTS, TABLE_1_PLANNING_S, TABLE_2_EXECUTION_S
from scripts.reach_sensitivity import main
from scripts.reach_sensitivity_report import write_report
from scripts.reach_sensitivity_rows import (
    GRID,
    Moves,
    Point,
    Row,
    distance,
    distances,
    fits,
    make_row,
    nearest,
    read_rows,
    write_rows,
)

ROOT = Path(__file__).parents[2]
HERE = Point(0.142, 15.0, None, False)


def row(obstacles: int = 3, point: Point = HERE, board: str = "3x6", **values: float) -> Row:
    """A row whose optimum and baseline are the paper's, but for `values`."""
    paper = REARRANGEMENTS[board]
    made = make_row(GRID, 0, board, point, obstacles, [Moves(1, 2, True)] * 4)
    dqn, baseline = paper["dqn"][obstacles].mean, paper["baseline"][obstacles].mean
    same = {"optimum_mean": dqn, "optimum_low": dqn, "optimum_high": dqn, "both_optimum_mean": dqn}
    return replace(made, **{**same, "baseline_mean": baseline, **values})


def test_the_papers_rows_are_whole_and_their_savings_are_those_of_the_text() -> None:
    for table in (TABLE_1_PLANNING_S, TABLE_2_EXECUTION_S, *REARRANGEMENTS.values()):
        assert all(tuple(cells) == OBSTACLES for cells in table.values())
    ((board, saved), (other, saved_there)) = (
        (board, 1 - sum(cell.mean for cell in rows["dqn"].values()) / sum(c.mean for c in rows["baseline"].values()))
        for board, rows in REARRANGEMENTS.items()
    )
    assert (board, other) == ("3x6", "6x6")
    # The text says 34 % and 36 %; it may average the columns' percentages.
    assert saved == pytest.approx(0.34, abs=0.02)
    assert saved_there == pytest.approx(0.36, abs=0.02)
    assert REARRANGEMENTS["3x6"]["dqn"][9].half95 == pytest.approx(2.262 * 0.94 / math.sqrt(10))


def test_a_row_counts_the_optimum_over_all_and_the_baseline_over_what_both_solve() -> None:
    moves = [Moves(1, 2, True), Moves(3, 5, True), Moves(4, None, True), Moves(None, None, True)]
    one = make_row(GRID, 0, "6x6", HERE, 5, [*moves, Moves(2, None, False)])
    assert (one.optimum_n, one.optimum_solved, one.optimum_mean) == (5, 0.8, 2.5)
    assert (one.baseline_n, one.baseline_solved, one.baseline_mean, one.both_optimum_mean) == (4, 0.5, 3.5, 2.0)
    assert one.optimum_sd == pytest.approx(math.sqrt(5 / 3))
    assert math.isnan(one.baseline_low)
    assert (one.paper_dqn_mean, one.paper_baseline_sd, one.n_sectors) == (2.1, 0.63, 30)


def test_distances_are_root_mean_squares_over_the_columns() -> None:
    near = REARRANGEMENTS["3x6"]
    columns = [
        row(3, optimum_mean=near["dqn"][3].mean + 0.3, baseline_mean=near["baseline"][3].mean - 1),
        row(4, optimum_mean=near["dqn"][4].mean - 0.4, both_optimum_mean=near["dqn"][4].mean + 2),
    ]
    found = distance(columns)
    assert found.dqn == pytest.approx(math.sqrt((0.3**2 + 0.4**2) / 2))
    assert found.baseline == pytest.approx(math.sqrt(1 / 2))
    assert found.dqn_both == pytest.approx(math.sqrt(4 / 2))
    assert math.isnan(distance([row(3, baseline_mean=math.nan)]).baseline)


def test_above_needs_more_than_the_interval_of_the_difference() -> None:
    cell = REARRANGEMENTS["6x6"]["dqn"][9]
    half = math.hypot(0.2, cell.half95)
    for excess, above in ((half - 0.01, 0), (half + 0.01, 1)):
        mean = cell.mean + excess
        columns = [row(9, board="6x6", optimum_mean=mean, optimum_high=mean + 0.2)]
        assert distance(columns).above == above


def test_the_nearest_point_has_both_rows_near_in_units_of_the_least() -> None:
    paper = REARRANGEMENTS["3x6"]
    off = {"optimum": (0.1, 1.0, 0.2, 0.1), "baseline": (4.0, 2.0, 2.4, math.nan)}
    points = [Point(r, 15.0, None, False) for r in (0.1, 0.2, 0.3, 0.4)]
    rows = [
        row(3, point, optimum_mean=paper["dqn"][3].mean + a, baseline_mean=paper["baseline"][3].mean + b)
        for point, a, b in zip(points, off["optimum"], off["baseline"], strict=True)
    ]
    found = distances(rows)
    known = fits(found)
    assert list(known) == points[:3]
    assert known[points[2]].joint == pytest.approx(math.sqrt((2**2 + 1.2**2) / 2))
    assert known[points[2]].plain == pytest.approx(math.sqrt((0.2**2 + 2.4**2) / 2))
    assert nearest(found) == points[0] == min(known, key=lambda point: known[point].joint)
    with pytest.raises(InputError, match=r"^rows: no point"):
        nearest({points[3]: found[points[3]]})


def tiny(tmp_path: Path, *more: str) -> list[str]:
    sizes = ["--instances", "5", "--baseline-instances", "5", "--check-instances", "6", "--obstacles", "3", "4"]
    reaches = ["--clearance", "0.106", "0.142", "--fan", "30", "--corridor", "clearance", "0.16"]
    return ["--csv", str(tmp_path / "run/rows.csv"), "--report", str(tmp_path / "page"), *sizes, *reaches, *more]


def test_a_tiny_grid_ends_in_a_page_that_the_csv_alone_makes_again(tmp_path: Path) -> None:
    main(tiny(tmp_path))
    rows = read_rows(tmp_path / "page.csv")
    assert len(rows) == 2 * 2 * 2 * 2 * 2 + 2 * 2
    assert (tmp_path / "page.png").read_bytes().startswith(b"\x89PNG")
    page = (tmp_path / "page.md").read_text(encoding="utf-8")
    assert "`reach=paper_fit`" in page
    assert " nan" not in page
    write_report(tmp_path / "page.csv", tmp_path / "again", "scripts/reach_sensitivity.sh")
    assert (tmp_path / "again.md").read_text(encoding="utf-8").replace("again.png", "page.png") == page


def test_a_stopped_study_goes_on_to_the_same_rows(tmp_path: Path) -> None:
    main(tiny(tmp_path))
    csv = tmp_path / "run/rows.csv"
    whole = csv.read_bytes()
    write_rows(csv, [one for one in read_rows(csv) if one.board == "3x6" and one.stage == GRID])
    assert csv.read_bytes() != whole
    main(tiny(tmp_path))
    assert csv.read_bytes() == whole


@pytest.mark.parametrize(
    ("more", "named"),
    [
        (["--seed", "7"], "holds rows of other arguments"),
        (["--baseline-instances", "6"], "--baseline-instances: got 6, want 5 at most"),
        (["--instances", "0"], "--instances: got 0"),
        (["--corridor", "-1"], "--corridor: got '-1', want"),
        (["--corridor", "wide"], "--corridor: got 'wide', want"),
    ],
)
def test_bad_arguments_are_one_line_and_exit_code_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], more: list[str], named: str
) -> None:
    (tmp_path / "run").mkdir()
    write_rows(tmp_path / "run/rows.csv", [row(point=Point(0.106, 30.0, None, False))])
    with pytest.raises(SystemExit) as ended:
        main(tiny(tmp_path, *more))
    assert ended.value.code == 2
    assert named in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.parametrize("text", ["", "stage,seed\n", "damaged"])
def test_a_damaged_csv_is_named(tmp_path: Path, text: str) -> None:
    path = tmp_path / "rows.csv"
    write_rows(path, [row()])
    path.write_text(path.read_text().replace("grid,0", "grid,x") if text == "damaged" else text)
    with pytest.raises(InputError, match=r"rows\.csv"):
        read_rows(path)


def test_paper_fit_is_the_nearest_point_of_the_page() -> None:
    rows = read_rows(ROOT / "docs/results/reach_sensitivity.csv")
    best = nearest(distances(one for one in rows if one.stage == GRID))
    preset = yaml.safe_load((ROOT / "conf/reach/paper_fit.yaml").read_text(encoding="utf-8"))
    sectors = {one.n_sectors for one in rows if one.point == best}
    assert {(preset["clearance_m"], preset["half_fan_deg"])} == {best[:2]}
    assert {preset["n_sectors"]} == sectors
    # The preset is a reach; the corridor that goes with it is the planner's default.
    baseline = yaml.safe_load((ROOT / "conf/planner/straight_line.yaml").read_text(encoding="utf-8"))
    assert (baseline["corridor_m"], baseline["avoid_corridors"]) == best[2:]


def test_the_command_of_the_page_runs(tmp_path: Path) -> None:
    environment = os.environ | {"BIN": str(Path(sys.executable).parent)}
    done = subprocess.run(
        [ROOT / "scripts/reach_sensitivity.sh", *tiny(tmp_path)],
        capture_output=True, text=True, cwd=tmp_path, env=environment, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == f"{tmp_path / 'page'}.md"
