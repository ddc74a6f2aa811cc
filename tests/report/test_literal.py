"""The runner of the paper's runs: it stops in time, resumes from its checkpoint, and its page says how far it is."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest

from dore.report import results
from scripts.literal_rows import Options, main
from scripts.program import run
from tests.commands import TINY
from tests.report.fakes import study, training

ROOT = Path(__file__).parents[2]


def run_folder(folder: Path, *tests: tuple[float, ...], column: str = "6x6_z3-8", **done: object) -> Path:
    """A run of 30,000 episodes, whose targets are copied every 10,000 updates."""
    size, _, obstacles = column.partition("_z")
    low, high = map(int, obstacles.split("-"))
    training(
        folder,
        agent={"_target_": "dore.learn.agents.sequential.Sequential"},
        layout=dict(zip(("rows", "cols"), map(int, size.split("x")), strict=True)),
        instances={"min_obstacles": low, "max_obstacles": high},
        training={"max_episodes": 30000, "update_after": "episode", "updates": 1},
        target_update={"value_network_update_interval": 9999},
        ipt={"every_episodes": 1000},
    )
    lines = ["episodes,updates,success,loss,epsilon", *(",".join(map(str, one)) for one in tests)]
    (folder / "metrics.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "done.json").unlink()
    if done:
        end = {"episodes": 30000, "seconds": 60.0, "best_success": 0.91}
        (folder / "done.json").write_text(json.dumps(end | done), encoding="utf-8")
    return folder


TESTS = ((1000, 1000, 0.625, 0.5, 0.9), (12000, 12000, 0.91, 0.5, 0.5), (30000, 30000, 0.4, 0.5, 0.1))


def page(tmp_path: Path) -> str:
    return results.write_page(study("literal"), "literal", None, tmp_path).read_text(encoding="utf-8")


def test_the_page_tells_last_from_best_and_how_far_a_run_is(tmp_path):
    for name, tests, done in (
        ("sequential_6x6_z3-8_seed0", TESTS, {"stop_reason": "budget"}),
        ("sequential_6x6_z3-8_natural_seed0", TESTS[:2], {}),
        ("sequential_6x6_z3-8_step_seed0", (), {}),
    ):
        folder = run_folder(tmp_path / "runs" / name, *tests, **done)
        assert run(main, Options, [f"run={folder}", f"out={tmp_path / 'literal' / name}"]) == 0
    every = page(tmp_path).splitlines()
    lines = [line for line in every if line.startswith("| sequential")]
    head = "| sequential | 6x6, 3-8 | 0 |"
    assert lines == [
        f"{head} as printed | 95 | 40.0 | 91.0 (12,000) | 30,000 | 100.0 % | 3 | at T_lim |",
        f"{head} natural | 95 | 91.0 | 91.0 (12,000) | 12,000 | 40.0 % | 1 | under way |",
        f"{head} step | 95 | - | - | 0 | 0 % | 0 | fills its replay |",
    ]
    readings = [line for line in every if line.startswith(("| as printed", "| natural", "| step"))]
    assert readings == [
        "| as printed | 62.5 | 64.5 | - | - | 91.0 | 30,000 | 100.0 % |",
        "| natural | 62.5 | - | - | - | 91.0 | 12,000 | 40.0 % |",
    ]
    assert (tmp_path / "literal.png").stat().st_size > 20_000


def test_what_is_no_run_is_one_line(tmp_path, capsys):
    assert run(main, Options, [f"run={tmp_path}", f"out={tmp_path / 'name'}"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "is no run folder" in line


def runner(minutes: str, environment: dict[str, str], code: int = 0) -> subprocess.CompletedProcess[str]:
    script = [str(ROOT / "scripts" / "literal.sh"), minutes]
    done = subprocess.run(script, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == code, done.stderr
    return done


@pytest.mark.parametrize("minutes", ["", "abc", "1.5", "1", "-5"])
def test_minutes_in_which_no_run_could_leave_a_checkpoint_are_refused(minutes):
    (line,) = runner(minutes, dict(os.environ), code=2).stderr.splitlines()
    assert f"minutes: got '{minutes}', want a whole number of 2 or more" in line


def test_a_pattern_that_names_no_run_is_refused(tmp_path):
    environment = os.environ | {"ONLY": "nothing", "LITERAL_HOME": str(tmp_path)}
    (line,) = runner("3", environment, code=2).stderr.splitlines()
    assert "ONLY: 'nothing' is the name of no run" in line


@pytest.mark.slow
def test_the_runner_stops_in_time_resumes_and_skips_what_is_done(tmp_path):
    tiny = [one for one in TINY if not one.startswith(("layout.", "instances.m", "ipt.target", "logger", "training."))]
    tiny += ["instances.train_size=50", "training.fill=40", "training.max_episodes=600", "ipt.batch_size=20"]
    environment = os.environ | {
        "LITERAL_HOME": str(tmp_path / "home"),
        "RESULTS": str(tmp_path / "results"),
        "ONLY": "*_6x6_z3-5_seed0",
        "MORE": " ".join(tiny),
    }

    def start(minutes: int) -> str:
        return runner(str(minutes), environment).stdout

    said = start(3)
    assert said.count("== ") == 2
    about = json.loads((tmp_path / "results" / "sequential_6x6_z3-5_seed0.json").read_text())
    assert (about["stop_reason"], about["t_lim"], about["reading"]) == ("budget", 600, "")
    assert "==" not in start(3)
