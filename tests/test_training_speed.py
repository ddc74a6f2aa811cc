"""The training loop's speed: one run measured, the page by hand, and what the script measures."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import time
from pathlib import Path

import hydra
import pytest
from hydra.core.global_hydra import GlobalHydra

from dore.paths import conf_dir
from scripts import bench_training
from scripts.bench_training import STAGES, Measured, Stages, figures
from scripts.training_speed_figure import COLOURS
from scripts.training_speed_page import BOARDS, COMPARED, CORES, main
from tests.commands import TINY

ROOT = Path(__file__).parents[1]
WANTED = [*(name for one in COMPARED for name in (one.before, *(name for _, name in one.after))), *BOARDS, *CORES]


def test_a_line_adds_up(capsys):
    GlobalHydra.instance().clear()
    overrides = [*TINY, "training.learning_starts=40"]
    assert bench_training.main(["--seconds", "0.3", "--processes", "2", "--name", "mine", *overrides]) == 0
    line = json.loads(capsys.readouterr().out)
    assert (line["name"], line["overrides"], line["board"], line["processes"]) == ("mine", overrides, "3x3", 2)
    assert line["seconds"] >= 0.3
    assert sum(line["shares"].values()) == pytest.approx(1)
    assert sum(line["stages"].values()) == pytest.approx(line["seconds"])
    assert list(line["shares"]) == list(STAGES)
    # Each stage is at work in the tiny run, and what is in no stage is little.
    assert all(share > 0 for share in line["shares"].values()), line["shares"]
    assert line["shares"]["rest"] < 0.3
    assert line["env_steps"] % 16 == 0
    assert line["updates"] == 2 * line["env_steps"] / 16
    assert line["env_steps_per_s"] == pytest.approx(line["env_steps"] / line["seconds"])
    assert line["updates_per_s"] == pytest.approx(line["updates"] / line["seconds"])
    assert line["samples_per_s"] == pytest.approx(8 * line["updates_per_s"])


def test_an_inner_stage_is_taken_from_the_outer():
    stages = Stages()
    inner = stages.timed("decoding", lambda: time.sleep(0.03))
    began = time.perf_counter()
    stages.timed("policy", lambda: (time.sleep(0.02), inner(), inner()))()
    taken = time.perf_counter() - began
    assert stages.seconds["decoding"] >= 0.06
    assert 0.02 <= stages.seconds["policy"] < taken - 0.06
    assert sum(stages.seconds.values()) == pytest.approx(taken, abs=0.005)


def test_two_processes_are_added_up():
    stages = dict.fromkeys(STAGES, 0.0)
    one = Measured(2.0, 1.0, 100, 8, stages | {"policy": 2.0}, 1, (0.5, 1.0))
    other = Measured(4.0, 4.0, 200, 16, stages | {"policy": 1.0, "rest": 3.0}, 1, (0.7, 1.2))
    line = figures([one, other], batch_size=10)
    assert (line["seconds"], line["cpu_seconds"], line["env_steps"], line["updates"]) == (3, 2.5, 300, 24)
    assert (line["env_steps_per_s"], line["samples_per_s"]) == (100, 80)
    assert (line["shares"]["policy"], line["shares"]["rest"]) == (0.5, 0.5)
    assert line["load"] == [0.5, 1.2]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--seconds", "0"], "--seconds: got 0.0"),
        (["--processes", "0"], "--processes: got 0"),
        (["device=cuda"], "device: got 'cuda', want cpu"),
        (["nothing=1"], "nothing"),
    ],
)
def test_what_is_asked_for_wrongly(arguments, says, capsys):
    GlobalHydra.instance().clear()
    assert bench_training.main(arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert says in line


def line_of(name: str, env_steps: int, **other: object) -> str:
    """A line of ten seconds, at four updates for 256 steps."""
    stages = {stage: 10 / len(STAGES) for stage in STAGES}
    side = name.rsplit("/", 1)[1] if "board" in name else "8x8"
    values = {
        **{"name": name, "overrides": [], "board": side, "obstacles": [3, 13], "batch_size": 256, "num_envs": 256},
        **{"commit": name.split("/")[0], "torch": "2", "machine": "m", "cores": 2, "processes": 1, "threads": 1},
        **{"load": [0.5, 1.25], "seconds": 10.0, "cpu_seconds": 9.5, "env_steps": env_steps},
        **{"updates": env_steps // 64, "stages": stages},
    }
    return json.dumps(values | other) + "\n"


def test_page_by_hand(tmp_path, capsys):
    rows = tmp_path / "rows.jsonl"
    steps = {"before/literal": 6400, "after/literal": 12800, "after/board/10x10": 3200, "after/cores/processes": 24000}
    text = "".join(line_of(name, steps.get(name, 12800)) for name in WANTED)
    rows.write_text(text + line_of("after/literal", 25600, load=[0.25, 2.0]))
    assert main([str(rows), str(tmp_path / "report" / "speed")]) == 0
    page = (tmp_path / "report" / "speed.md").read_text(encoding="utf-8")
    assert "commits before before and after after" in page
    assert "Load from 0.25 to 2.00" in page
    assert "had 95 % of a core or more" in page
    # (12,800 + 25,600) steps in 20 s, against 6,400 in 10.
    literal = "| literal, after | **3.00** | 640 | 1,920 [1,280, 2,560] | 10.0 | 30.0 | 7,680 | 0.25-2.00 |"
    assert literal in page
    assert "| 10 x 10 | 13 | **0.25** | 320 | 5.0 | 0.50-1.25 |" in page
    assert "| two processes, one thread each | **1.88** | 2,400 |" in page
    assert "| decoding |" + " 8.3 |" * 8 in page
    assert "| ms an update | 100.00 | 33.33 |" in page
    with (tmp_path / "report" / "speed.csv").open(encoding="utf-8", newline="") as file:
        table = {line["name"]: line for line in csv.DictReader(file)}
    assert list(table) == WANTED
    assert (table["after/literal"]["rounds"], table["after/literal"]["env_steps_per_s"]) == ("2", "1920.0")
    assert float(table["after/literal"]["share_mean_of_weights"]) == pytest.approx(1 / 12, abs=1e-4)
    assert (tmp_path / "report" / "speed.png").stat().st_size > 10_000
    assert list(COLOURS) == list(STAGES)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (None, "cannot be read"),
        ("", "nothing is measured yet"),
        ("{", "want lines of scripts/bench_training.py"),
        ('{"name": "a"}\n', "want lines of scripts/bench_training.py"),
        (line_of("before/literal", 64), "no after/literal, before/planes"),
        (line_of("a", 64) + line_of("a", 64, batch_size=8), "a: measured with different batch_size"),
    ],
)
def test_lines_that_are_not_what_the_page_wants(text, says, tmp_path, capsys):
    rows = tmp_path / "rows.jsonl"
    if text is not None:
        rows.write_text(text)
    assert main([str(rows), str(tmp_path / "report" / "speed")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert says in line
    assert not (tmp_path / "report").exists()


STUB = """\
#!/usr/bin/env bash
printf '%s\\t' "$PYTHONPATH" "$@" >>"$CALLS"
echo >>"$CALLS"
[ "$1" = -m ] || echo "{\\"name\\": \\"$5\\"}"
"""


@pytest.fixture(scope="module")
def calls(tmp_path_factory) -> dict[str, list[str]]:
    """What the script runs for each name: PYTHONPATH and overrides, after it was started twice."""
    folder = tmp_path_factory.mktemp("speed")
    (folder / "bin").mkdir()
    for name, text in (("python", STUB), ("git", "#!/bin/sh\n")):
        (folder / "bin" / name).write_text(text)
        (folder / "bin" / name).chmod(0o755)
    environment = os.environ | {
        "PATH": f"{folder / 'bin'}:{os.environ['PATH']}",
        "BIN": str(folder / "bin"),
        "CALLS": str(folder / "calls"),
        "OUT": str(folder / "out"),
        "REPORT": "page",
        "SECONDS_EACH": "7",
    }
    environment.pop("PYTHONPATH", None)
    for _ in range(2):
        subprocess.run([str(ROOT / "scripts" / "training_speed.sh")], env=environment, capture_output=True, check=True)
    lines = [line.rstrip("\t").split("\t") for line in (folder / "calls").read_text().splitlines()]
    pages = [line for line in lines if line[1] == "-m"]
    assert pages == [["", "-m", "scripts.training_speed_page", str(folder / "out" / "rows.jsonl"), "page"]] * 2
    measured = [line for line in lines if line[1] != "-m"]
    assert all(line[1:5] == ["scripts/bench_training.py", "--seconds", "7", "--name"] for line in measured)
    assert [line[5] for line in measured] == 2 * WANTED
    return {line[5]: [line[0], *line[6:]] for line in measured}


@pytest.mark.parametrize("name", WANTED)
def test_every_run_of_the_script_is_one_of_dore_train(name, calls):
    tree, *overrides = calls[name]
    assert (tree == str(ROOT)) == name.startswith("after/")
    processes = 2 if overrides[0] == "--processes" else 1
    GlobalHydra.instance().clear()
    with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
        cfg = hydra.compose("train", overrides[2 * (processes - 1) :])
    cells = cfg.layout.rows * cfg.layout.cols
    assert processes == 1 + (name == "after/cores/processes")
    assert cfg.threads == 1 + (name == "after/cores/threads")
    assert cfg.instances.max_obstacles == round(0.2 * cells)
    assert cfg.training.learning_starts == 2000
    if name.startswith("before/"):
        # The old tree knows no precision.
        assert not [one for one in overrides if "precision" in one]
    elif name != "after/literal":
        assert cfg.training.precision == ("float32" if name.endswith("float32") else "bfloat16")
    assert cfg.agent.encoding == {"literal": "state", "planes": "planes"}.get(name.split("/")[1], "lanes")
