"""The runner of the paper's runs: it stops in time, goes on from its checkpoint, and its page says how far it is."""

from __future__ import annotations

import csv
import json
import os
import subprocess
from pathlib import Path

import pytest

from scripts.literal import COLUMNS, Run, Test, lines_of, main, read_runs, write_run
from tests.commands import TINY

ROOT = Path(__file__).parents[2]


def a_run(**changes) -> Run:
    tests = (Test(1000, 1000, 0.1, 0.1, 62.5, 0.5, 0.9, 0), Test(12000, 12000, 0.4, 0.4, 91.0, 0.5, 0.5, 1))
    tests += (Test(30000, 30000, 1.0, 1.0, 40.0, 0.5, 0.1, 3),)
    plain = {"name": "sequential_6x6_z3-8_seed0", "structure": "sequential", "column": "6x6_z3-8", "seed": 0}
    plain |= {"reading": "", "t_lim": 30000, "t_lim_updates": 30000, "copy_every": 10000, "commit": "abc"}
    return Run(**(plain | {"ending": "budget", "tests": tests} | changes))


def test_what_is_written_is_read_again(tmp_path):
    runs = [a_run(), a_run(name="b", reading="natural", ending=None), a_run(name="c", column="6x6_z3-5", tests=())]
    for run in runs:
        write_run(run, tmp_path / "literal" / run.name)
    assert read_runs(tmp_path / "literal") == [runs[2], runs[0], runs[1]]
    with open(tmp_path / "literal" / "b.csv", encoding="utf-8") as file:
        assert tuple(next(csv.reader(file))) == COLUMNS
    assert main(["page", str(tmp_path / "literal")]) == 0
    assert (tmp_path / "literal.png").stat().st_size > 20_000
    assert len((tmp_path / "literal.md").read_text(encoding="utf-8").splitlines()) == len(lines_of(runs, "literal"))


def test_the_page_tells_last_from_best_and_how_far_a_run_is():
    row = lines_of([a_run()], "literal")[-3]
    assert "| 95 | 40.0 | 91.0 (12,000) | 30,000 | 100.0 % | 3 | at T_lim |" in row
    unfinished = a_run(ending=None, tests=a_run().tests[:2])
    assert "| 91.0 | 91.0 (12,000) | 12,000 | 40.0 % | 1 | under way |" in lines_of([unfinished], "literal")[-3]


def test_nothing_to_draw_is_one_line(tmp_path, capsys):
    assert main(["page", str(tmp_path / "none")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "holds no run" in line


@pytest.mark.slow
def test_the_runner_stops_in_time_goes_on_and_skips_what_is_done(tmp_path):
    tiny = [one for one in TINY if not one.startswith(("layout.", "instances.m", "ipt.target", "logger", "training."))]
    tiny += ["instances.train_size=50", "training.fill=40", "training.max_episodes=600", "ipt.batch_size=20"]
    environment = os.environ | {
        "LITERAL_HOME": str(tmp_path / "home"),
        "RESULTS": str(tmp_path / "results"),
        "ONLY": "*_6x6_z3-5_seed0",
        "MORE": " ".join(tiny),
    }

    def start(minutes: int) -> str:
        script = [str(ROOT / "scripts" / "literal.sh"), str(minutes)]
        return subprocess.run(script, env=environment, capture_output=True, text=True, check=True).stdout

    assert "==" not in start(1), "no run is begun that could not leave a checkpoint in time"
    said = start(3)
    assert said.count("== ") == 2
    about = json.loads((tmp_path / "results" / "sequential_6x6_z3-5_seed0.json").read_text())
    assert (about["ending"], about["t_lim"], about["reading"]) == ("budget", 600, "")
    assert "==" not in start(3)
