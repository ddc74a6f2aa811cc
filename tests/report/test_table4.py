"""Table 4: its presets say what the paper says, its figures are right by hand, and its script ends on tiny runs."""

from __future__ import annotations

import csv
import os
import shutil
import subprocess
from pathlib import Path

import hydra
import pytest
from hydra.core.global_hydra import GlobalHydra

from dore.errors import InputError
from dore.files import conf_dir
from dore.report.evaluation import Row, Timing
from dore.world.plan import Status
from scripts.learning_curves import Ipt, band, reached
from scripts.paper_entries import Entry, Metric
from scripts.table4_metrics import IMPROVED, RATIO, SUCCESS, metrics_of
from scripts.table4_page import main
from scripts.table4_runs import COLUMNS, Runs, Trained, read_runs
from tests.commands import TINY

ROOT = Path(__file__).parents[2]
COLUMN = "6x6_z3-8"


def composed(*overrides: str):
    GlobalHydra.instance().clear()
    with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
        return hydra.compose("train", list(overrides), return_hydra_config=True)


@pytest.mark.parametrize("column", COLUMNS)
@pytest.mark.parametrize(
    ("paper", "e_r", "widths", "failed"),
    [("single", 595000, [600, 500, 400, 300], -3), ("sequential", 70000, [400, 300, 300], -3)],
)
def test_every_number_of_table_5(column, paper, e_r, widths, failed):
    cfg = composed("experiment=paper/table4", f"paper={paper}", f"column={column}")
    size, obstacles = column.split("_z")
    assert f"{cfg.layout.rows}x{cfg.layout.cols}" == size
    assert f"{cfg.instances.min_obstacles}-{cfg.instances.max_obstacles}" == obstacles
    assert cfg.agent._target_.endswith({"single": ".Single", "sequential": ".Sequential"}[paper])
    assert cfg.instances.train_size == e_r
    assert cfg.training.max_episodes == 15 * e_r
    assert (cfg.instances.train_size + cfg.instances.validation_size) * 7 == cfg.instances.train_size * 10, (
        "70 and 30 %"
    )
    assert cfg.training.fill == min(5 * e_r, cfg.buffer.storage.max_size)
    assert (cfg.training.update_after, cfg.training.updates, cfg.training.keep) == ("episode", 1, "last")
    assert (cfg.ipt.target_success, cfg.ipt.batch_size, cfg.ipt.every_episodes, cfg.ipt.n_batches) == (
        0.95,
        1000,
        1000,
        5,
    )
    assert (cfg.training.batch_size, cfg.buffer.storage.max_size) == (32, 1000000)
    assert cfg.target_update.value_network_update_interval + 1 == 10000
    assert (cfg.agent.gamma, cfg.optimizer.lr) == (0.99, 0.0025)
    assert (cfg.exploration.start, cfg.exploration.end) == (1.0, 0.1)
    assert list(cfg.network.widths) == widths
    assert (cfg.env.rewards.solved, cfg.env.rewards.unfinished, cfg.env.rewards.failed) == (10, 0, failed)
    # What the paper leaves open, in its literal form: docs/paper.md.
    literal = {"mask_mode": "literal", "double": False, "loss_function": "l2", "symmetry": False, "encoding": "state"}
    literal |= {"heads": "independent"} if paper == "single" else {"chain": "literal", "failed_pick": "skip"}
    assert {key: cfg.agent[key] for key in literal} == literal
    assert cfg.training.min_episodes == 0


def test_the_first_column_of_table_5():
    cfg = composed("experiment=paper/single_3x6")
    assert (cfg.layout.rows, cfg.instances.train_size, cfg.training.max_episodes) == (3, 119000, 1785000)
    assert (cfg.training.fill, cfg.env.rewards.failed, list(cfg.network.widths)) == (
        595000,
        -1,
        [400, 300, 300],
    )


@pytest.mark.parametrize(
    ("experiment", "keys"), [("paper/table4", ["paper", "column"]), ("table4", ["column", "seed"])]
)
def test_the_sweeps_are_the_whole_table(experiment, keys):
    params = composed(f"experiment={experiment}").hydra.sweeper.params
    assert list(params) == keys
    assert params.column.split(",") == list(COLUMNS)


def rows(planner: str, *moves: int | None) -> list[Row]:
    """A row an instance: its moves, None for a planner that gave up, 0 for a proof that there is no plan."""
    status = {None: Status.GAVE_UP, 0: Status.UNSOLVABLE}
    return [
        Row(
            planner,
            number,
            36,
            3,
            status.get(m, Status.SOLVED),
            "" if m else "move budget",
            m or 0,
            0.1,
            0,
            Timing.BATCHED,
        )
        for number, m in enumerate(moves, 1)
    ]


def trained(*tests: tuple[int, float, float], episodes: int = 900) -> Trained:
    done = {"episodes": episodes, "updates": 7, "seconds": 120.0, "best_success": 0.97, "ending": "budget"}
    return Trained(done, composed("experiment=paper/table4"), [Ipt(*test) for test in tests])


def by_hand() -> Runs:
    """Five instances: the fourth has no plan, the fifth is proved by none, but solved by the guided search."""
    found = {
        "exact": rows("exact", 1, 2, 2, 0, None),
        "single": rows("learned", 1, None, None, None, None),
        "seed0": rows("learned", 1, 3, 2, None, None),
        "seed1": rows("learned", 1, 2, 2, None, 4),
        "generalist": [*rows("learned", 1, 2, None, None, None), *rows("guided", 1, 2, 2, None, 3)],
    }
    literal = {
        ("single", COLUMN): trained((100, 10.0, 0.5), (400, 40.0, 0.95)),
        ("sequential", COLUMN): trained((100, 10.0, 0.5), (300, 30.0, 0.9)),
    }
    improved = {
        ("seed0", COLUMN): trained((10, 1.0, 0.96), episodes=20),
        ("seed1", COLUMN): trained((10, 1.0, 0.9), (30, 3.0, 0.97), episodes=40),
    }
    return Runs(literal, improved, improved, {COLUMN: found}, {}, [], [])


def entry(metrics: list[Metric], name: str, row: str) -> Entry:
    (found,) = [one for metric in metrics if metric.name == name for one in metric.entries if one.row == row]
    return found


def test_figures_by_hand():
    metrics = metrics_of(by_hand())
    for row, n, percent in (
        ("literal: S-DQN", 4, 25),
        (IMPROVED, 2, (75 + 100) / 2),
        ("generalist", 4, 50),
        ("generalist, guided", 4, 100),
        ("paper: S-DQN", None, 78),
        ("of all instances, solvable", 5, 80),
    ):
        found = entry(metrics, SUCCESS, row)
        assert (found.n, found.value.value) == (n, percent), row
    improved = entry(metrics, SUCCESS, IMPROVED).value
    assert (improved.low, improved.high) == (75, 100)
    # The fifth instance has a plan, but no optimum that it could be set against.
    assert entry(metrics, RATIO, IMPROVED).value.value == pytest.approx((6 / 5 + 1) / 2)
    assert entry(metrics, RATIO, "generalist, guided").n == 3
    assert entry(metrics, RATIO, "proved optimum, rearrangements").value.value == pytest.approx(5 / 3)
    assert entry(metrics, "episodes to 95 % IPT", "literal: S-DQN").value.value == 400
    assert entry(metrics, "episodes to 95 % IPT", "literal S-DQN / improved").value.value == 400 / 20
    assert entry(metrics, "episodes to 95 % IPT", "literal SS-DQN / improved, more than").value.value == 300 / 20
    assert entry(metrics, "seconds to 95 % IPT", IMPROVED).value.value == 2
    assert entry(metrics, "how far the literal runs went", "S-DQN: of T_lim (%)").value.value == pytest.approx(
        90000 / 8925000
    )
    assert "No instance is undecided" in metrics[0].note
    assert entry(metrics, "how what is not solved ends (%)", "literal: S-DQN: move budget").value.value == 80


def test_bands_reach_as_far_as_all_runs():
    one, other = [Ipt(10, 1, 0.2), Ipt(30, 3, 0.6)], [Ipt(20, 2, 0.2), Ipt(50, 5, 0.8)]
    episodes, low, mean, high = band([one, other])
    assert episodes.tolist() == [20, 30]
    assert low.tolist() == pytest.approx([0.2, 0.4])
    assert mean.tolist() == pytest.approx([0.3, 0.5])
    assert high.tolist() == pytest.approx([0.4, 0.6])
    assert not len(band([])[0])
    assert reached(one, 0.5) == one[1]
    assert reached(one, 0.7) is None


def test_nothing_tested_is_one_line(tmp_path, capsys):
    assert main([str(tmp_path), str(tmp_path / "report" / "t")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "no column is tested" in line
    assert not (tmp_path / "report").exists()


@pytest.mark.slow
def test_the_script_ends_and_does_nothing_twice(tmp_path):
    """Two columns, one seed, models of seconds; the second start finds all done, and refuses other instances."""
    small = [one for one in TINY if not one.startswith(("layout.", "instances.m", "ipt.every", "logger"))]
    out = tmp_path / "out"
    environment = os.environ | {
        "OUT": str(out),
        "REPORT": str(tmp_path / "table4"),
        "TEST_SIZE": "5",
        "COLUMNS": "6x6_z3-5 7x7_z3-5",
        "SEEDS": "0,1",
        "LITERAL": "instances.train_size=50 training.fill=32",
        "TRAIN": " ".join([*small, "ipt.every_episodes=50"]),
    }
    script = [str(ROOT / "scripts" / "table4.sh")]
    first = subprocess.run(script, env=environment, capture_output=True, text=True, check=False)
    assert first.returncode == 0, first.stderr
    assert "4 jobs done (0 of them before), 0 broken" in first.stdout
    again = subprocess.run(script, env=environment, capture_output=True, text=True, check=True)
    assert again.stdout.count("4 jobs done (4 of them before), 0 broken") == 3
    assert again.stdout.count("is evaluated") == 2 * (2 + 2 + 2)
    page = (tmp_path / "table4.md").read_text(encoding="utf-8")
    for word in (
        "`scripts/table4.sh`, commit ",
        "| obstacles | 6 x 6, 3-5 | 7 x 7, 3-5 |",
        "| paper: S-DQN | 95 | 95 |",
    ):
        assert word in page, word
    with (tmp_path / "table4.csv").open(encoding="utf-8") as file:
        cells = list(csv.DictReader(file))
    assert {cell["column"] for cell in cells} == {"6x6_z3-5", "7x7_z3-5"}
    assert (tmp_path / "table4.png").stat().st_size > 10_000
    config = out / "test" / "6x6_z3-5" / "seed0" / "config.yaml"
    config.write_text(config.read_text(encoding="utf-8").replace("clearance_m: 0.142", "clearance_m: 0.15"))
    with pytest.raises(InputError, match=r"seed0: reach not as in .*exact, want the same instances"):
        read_runs(out)
    shutil.rmtree(out / "test")
    with pytest.raises(InputError, match="no column is tested"):
        read_runs(out)
