"""What the one network never saw: its worlds are told apart, its figures are right by hand, its script ends."""

from __future__ import annotations

import csv
import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from dore.learn.checkpoint import SHIPPED
from dore.report.evaluation import ROWS, Row, Timing, write_rows
from dore.world.plan import Status
from scripts.generalist_metrics import OF_ALL, RATIO, REACHES, SUCCESS, TOGETHER, metrics_of
from scripts.generalist_page import main
from scripts.generalist_worlds import Known, read_evaluations
from scripts.paper_entries import Entry, Metric
from scripts.planner_timing import composed

ROOT = Path(__file__).parents[2]
TRAINED = ("layout=6x6 instances=z3-9 reach=wide_hand", "layout=3x6 instances=z3-9 reach=panda_slim")


def rows(planner: str, *moves: int | None) -> list[Row]:
    """A row an instance: its moves, None for a planner that gave up, 0 for a proof that there is no plan."""
    status = {None: Status.GAVE_UP, 0: Status.UNSOLVABLE}
    return [
        Row(planner, number, 36, 7, status.get(m, Status.SOLVED), "", m or 0, 0.1, 0, Timing.BATCHED)
        for number, m in enumerate(moves, 1)
    ]


def evaluation(folder: Path, reach: str, size: str, percent: int, obstacles: int, **found: list[Row]) -> Path:
    """Write what scripts/generalist.sh leaves of a world; its folder."""
    world = folder / reach / f"{size}_{percent}"
    n = [f"instances.min_obstacles={obstacles}", f"instances.max_obstacles={obstacles}"]
    what = [f"layout={size}", f"reach={reach}", "instances=z3-7", *n, "planner=[learned,guided]"]
    cfg = composed([*what, "model=weights", "run_dir=run"])
    for name, mine in found.items():
        run = world / name
        run.mkdir(parents=True)
        (run / "config.yaml").write_text(OmegaConf.to_yaml(cfg), encoding="utf-8")
        (run / "about.json").write_text(json.dumps({"commit": "abc", "versions": {"torch": "2"}}), encoding="utf-8")
        write_rows(run / ROWS, mine)
    return world


@pytest.fixture
def folder(tmp_path):
    """Five instances: the fourth has no plan, the fifth is decided by nobody."""
    exact = rows("exact", 1, 2, 2, 0, None)
    model = [*rows("learned", 1, 3, None, None, None), *rows("guided", 1, 2, 2, None, None)]
    for reach, size, percent, obstacles in (
        ("wide_hand", "6x6", 20, 7),
        ("wide_hand", "6x6", 30, 11),
        ("wide_hand", "10x10", 20, 20),
        ("published", "6x6", 20, 7),
        ("panda_slim", "6x6", 20, 7),
    ):
        evaluation(tmp_path / "runs", reach, size, percent, obstacles, exact=exact, model=model)
    return tmp_path / "runs"


def entry(metrics: list[Metric], name: str, row: str, column: str) -> Entry:
    entries = [one for metric in metrics if metric.name == name for one in metric.entries]
    (found,) = [one for one in entries if (one.row, one.column) == (row, column)]
    return found


def test_what_the_network_has_learned_from(folder):
    known = {(one.reach, one.size, one.percent): one.known for one in read_evaluations(folder, TRAINED).worlds}
    assert known == {
        ("wide_hand", "6 x 6", 20): Known.TRAINED,
        ("wide_hand", "6 x 6", 30): Known.SIZE,
        ("wide_hand", "10 x 10, 9 cm", 20): Known.SIZE,
        ("published", "6 x 6", 20): Known.REACH,
        ("panda_slim", "6 x 6", 20): Known.SIZE,
    }


def test_figures_by_hand(folder):
    metrics = metrics_of(read_evaluations(folder, TRAINED))
    learned = entry(metrics, SUCCESS, "6 x 6, learned", "20 %")
    assert (learned.n, learned.value.value) == (3, pytest.approx(200 / 3))
    assert entry(metrics, SUCCESS, "6 x 6, guided", "30 %").value.value == 100
    assert entry(metrics, OF_ALL, "6 x 6, learned", "20 %").value.value == 40
    assert entry(metrics, OF_ALL, "6 x 6, solvable", "20 %").value.value == 60
    assert entry(metrics, OF_ALL, "6 x 6, undecided", "20 %").value.value == 20
    ratio = entry(metrics, RATIO, "6 x 6, learned", "20 %")
    assert (ratio.n, ratio.value.value) == (2, pytest.approx(4 / 3))
    assert entry(metrics, RATIO, "6 x 6, proved optimum", "20 %").value.value == pytest.approx(5 / 3)
    together = entry(metrics, TOGETHER, "learned", Known.SIZE)
    assert (together.n, together.value.value) == (9, pytest.approx(200 / 3))
    row = "published, 6 x 6, 20 %"
    assert 50 < entry(metrics, REACHES, row, "free at once %").value.value < 90
    assert entry(metrics, REACHES, row, "learned, of all %").value.value == 40


def test_the_page_marks_what_was_learned_from(folder, tmp_path):
    assert main([str(folder), str(tmp_path / "new" / "g")]) == 0
    page = (tmp_path / "new" / "g.md").read_text(encoding="utf-8")
    for line in (
        "5 instances of each world, of the test split",
        "5 instances of 25 stay undecided",
        "| 6 x 6, learned | 66.7 [20.8, 93.9] \\* | 66.7 [20.8, 93.9] |",
        "Nowhere are nine in ten boards free.",
    ):
        assert line in page, line
    assert "nan" not in page
    assert (tmp_path / "new" / "g.png").read_bytes().startswith(b"\x89PNG")
    with (tmp_path / "new" / "g.csv").open(encoding="utf-8") as file:
        cells = list(csv.DictReader(file))
    trained = {
        (cell["row"], cell["column"]) for cell in cells if cell["metric"] == "learned from" and cell["mean"] == "1"
    }
    assert trained == {("wide_hand, 6 x 6", "20 %")}


def test_what_cannot_be_a_page_is_one_line(folder, tmp_path, capsys):
    assert main([str(tmp_path / "none"), str(tmp_path / "g")]) == 2
    assert "nothing is evaluated" in capsys.readouterr().err
    config = folder / "published" / "6x6_20" / "model" / "config.yaml"
    config.write_text(config.read_text(encoding="utf-8").replace("clearance_m: 0.106", "clearance_m: 0.107"))
    assert main([str(folder), str(tmp_path / "g")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "reach not as in" in line


@pytest.mark.parametrize("reach", ["wide_hand", "paper_fit", "panda_slim", "published", "jaco", "panda"])
def test_the_scripts_worlds_keep_their_size(reach):
    cfg = composed(["layout=3x6", f"reach={reach}", "layout.rows=8", "layout.cols=8"])
    assert (cfg.layout.rows, cfg.layout.cols) == (8, 8)


@pytest.mark.slow
def test_the_script_ends_and_does_again_what_older_weights_did(tmp_path):
    weights = tmp_path / "weights.safetensors"
    shutil.copy(SHIPPED, weights)
    environment = os.environ | {
        "OUT": str(tmp_path / "out"),
        "REPORTS": str(tmp_path / "pages"),
        "MODEL": str(weights),
        "TEST_SIZE": "5",
        "SIZES": "6x6 10x10@0.11",
        "DENSITIES": "10",
        "REACHES": "panda",
        "REACH_SIZES": "3x6",
        "REACH_DENSITIES": "30",
        "FAILURE_BOARDS": "40",
    }
    script = [str(ROOT / "scripts" / "generalist.sh")]
    first = subprocess.run(script, env=environment, capture_output=True, text=True, check=False)
    assert first.returncode == 0, first.stderr
    pages = {path.name for path in (tmp_path / "pages").iterdir()}
    wanted = {"generalist.csv", "generalist.md", "generalist.png", "q_values.png", "failures.md"}
    assert wanted <= pages <= wanted | {"failures.png"}
    page = (tmp_path / "pages" / "generalist.md").read_text(encoding="utf-8")
    assert "| 10 x 10, 11 cm, learned |" in page
    assert "| panda, 3 x 6, 16 cm, 30 % | 5 |" in page
    os.utime(weights)
    again = subprocess.run(script, env=environment, capture_output=True, text=True, check=True)
    assert again.stdout.count("exact is evaluated") == 3
    assert again.stdout.count("model is evaluated") == 0
