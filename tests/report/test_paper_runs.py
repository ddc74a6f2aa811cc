"""Tables 1 to 3 from the folders of tiny runs: three files, one line for what does not belong together, the scripts."""

from __future__ import annotations

import csv
import os
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from dore.report.evaluation import read_rows, write_rows
from dore.report.tables import summarise
from scripts.paper_metrics import SOLVED
from scripts.paper_table import main
from tests.commands import TINY, run

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> Path:
    """What a table's script leaves, on 3 x 4 cells, with 3 and 4 obstacles."""
    small = [*TINY, "layout.cols=4", "instances.max_obstacles=4"]
    folder = tmp_path_factory.mktemp("runs")
    for model in ("single", "sequential"):
        train = folder / model / "train"
        assert run("train", [*small, f"agent={model}", f"run_dir={train}"]) == 0
        planners = "exact,graph_search,straight_line,learned,transfer" if model == "single" else "exact,learned"
        quick = ["planners.transfer.max_seconds=0.5"] if model == "single" else []
        for z in (3, 4):
            column = [f"instances.{end}_obstacles={z}" for end in ("min", "max")]
            common = [f"model={train}", "instances=z3-9", *column, "instances.test_size=8", *quick]
            assert run("evaluate", [*common, f"planner=[{planners}]", f"run_dir={folder / model / f'z{z}'}"]) == 0
    return folder


@pytest.mark.parametrize("table", ["1", "2", "3"])
def test_the_files_of_a_table(runs: Path, tmp_path: Path, table: str) -> None:
    report = tmp_path / "new" / "table"
    assert main([table, str(runs), str(report)]) == 0
    assert sorted(path.name for path in report.parent.iterdir()) == ["table.csv", "table.md", "table.png"]
    with open(report.with_suffix(".csv"), encoding="utf-8") as file:
        cells = list(csv.DictReader(file))
    assert list(cells[0]) == ["metric", "row", "column", "n", "mean", "sd", "low", "high"]
    (learned,) = [
        one for one in summarise(read_rows(runs / "sequential" / "z3" / "rows.csv")) if one.planner == "learned"
    ]
    (solved,) = [
        cell for cell in cells if (cell["metric"], cell["row"], cell["column"]) == (SOLVED, "learned (sequential)", "3")
    ]
    assert float(solved["mean"]) == pytest.approx(100 * learned.success_of_solvable.value, rel=1e-5)
    page = report.with_suffix(".md").read_text(encoding="utf-8")
    for word in (
        f"# Table {table}: ",
        f"`scripts/table{table}.sh`, commit ",
        "seed 0",
        "1 thread(s), timing=single",
        "Load of the machine when this page was made",
        "8 instances a column, of the test split",
        "trained with 1-4 obstacles",
        "![",
        "| obstacles | 3 | 4 |",
    ):
        assert word in page, word


def copied(runs: Path, to: Path) -> Path:
    return Path(shutil.copytree(runs, to / "copy"))


def test_runs_that_do_not_belong_together_are_one_line(runs: Path, tmp_path: Path, capsys) -> None:
    def refused(folder: Path) -> str:
        assert main(["2", str(folder), str(tmp_path / "report" / "t")]) == 2
        assert not (tmp_path / "report").exists()
        (line,) = capsys.readouterr().err.splitlines()
        shutil.rmtree(folder, ignore_errors=True)
        return line

    assert "columns [] of single and [] of sequential" in refused(tmp_path / "nothing")
    folder = copied(runs, tmp_path)
    shutil.rmtree(folder / "single" / "z4")
    assert "columns [3] of single and [3, 4] of sequential" in refused(folder)
    folder = copied(runs, tmp_path)
    config = folder / "sequential" / "z3" / "config.yaml"
    config.write_text(config.read_text(encoding="utf-8").replace("clearance_m: 0.142", "clearance_m: 0.15"))
    assert "z3: reach {" in refused(folder)
    folder = copied(runs, tmp_path)
    (folder / "single" / "train" / "done.json").unlink()
    assert "done.json: no such file; want a run that is done" in refused(folder)
    folder = copied(runs, tmp_path)
    (folder / "single" / "z3" / "rows.csv").unlink()
    assert "rows.csv: no such file" in refused(folder)
    folder = copied(runs, tmp_path)
    rows = folder / "single" / "z3" / "rows.csv"
    write_rows(rows, [replace(row, n_obstacles=5) for row in read_rows(rows)])
    assert "rows of 5 obstacles, want 3" in refused(folder)


@pytest.mark.slow
@pytest.mark.parametrize("table", [1, 2, 3])
def test_a_tables_script_ends_and_does_nothing_twice(tmp_path: Path, table: int) -> None:
    """On the paper's boards, with models of seconds."""
    small = [one for one in TINY if not one.startswith(("layout.", "instances.m", "ipt.every"))]
    environment = os.environ | {
        "OUT": str(tmp_path / "out"),
        "REPORT": str(tmp_path / "table"),
        "TEST_SIZE": "5",
        "COLUMNS": "3 5",
        "TRAIN": " ".join([*small, "ipt.every_episodes=100"]),
    }
    script = [str(ROOT / "scripts" / f"table{table}.sh")]
    first = subprocess.run(script, env=environment, capture_output=True, text=True, check=False)
    assert first.returncode == 0, first.stderr
    again = subprocess.run(script, env=environment, capture_output=True, text=True, check=True)
    assert again.stdout.count("is trained") == 2
    assert again.stdout.count("is evaluated") == 4
