"""The jobs of any command's sweep: their folders' names, and that what is done stays done; hints that can be pasted."""

from __future__ import annotations

import json
import shlex

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser

from dore.app.jobs import job_name
from dore.errors import pasted
from tests.commands import ctrl_c_at_plan, run


def test_names_of_jobs():
    """What was swept comes first, the seed last of it; a shell and Hydra take them as they are."""
    given = ["seed=0", "logger=none", "+network.depth=2", "network.widths=[16,8]", "agent=single", "sweep=mine"]
    name = job_name(given, ["seed", "agent"], ["sweep"])
    assert name == "agent-single_seed-0_logger-none_network.depth-2_network.widths-16-8"
    for other in (name, job_name(["experiment=paper/single", "x='a b'", "lr=-1e-3"], ["lr"], [])):
        assert shlex.quote(other) == other
        assert OverridesParser.create().parse_override(f"model=outputs/{other}").value() == f"outputs/{other}"
    long = [job_name([f"x={'a' * 200}", f"y={end}"], [], []) for end in "bc"]
    assert long[0] != long[1]
    assert job_name([f"x={'a' * 200}", "y=b", "sweep=mine"], [], ["sweep"]) == long[0]
    assert {len(one) for one in long} == {120}
    assert job_name(["sweep=mine"], [], ["sweep"]) == "defaults"


@pytest.mark.parametrize("folder", ["plain/run-1_a", "a b", "it's", "agent=single,seed=0", "$HOME", "tür"])
def test_a_hint_can_be_pasted(folder):
    (word,) = shlex.split(pasted("resume", folder))
    assert OverridesParser.create().parse_override(word).value() == folder


def test_other_commands_skip_what_is_done(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    arguments = ["-m", "planner=exact", "layout=3x6", "instances=z3-5", "sweep=mine"]
    assert run("plan", [*arguments, "seed=1,2"]) == 0
    jobs = sorted(path.parent.name for path in tmp_path.glob("outputs/sweeps/mine/*/plan.json"))
    assert jobs == [f"seed-{seed}_instances-z3-5_layout-3x6_planner-exact" for seed in (1, 2)]
    capsys.readouterr()
    (tmp_path / "outputs" / "sweeps" / "mine" / jobs[1] / "job.json").unlink()  # as if killed
    assert run("plan", [*arguments, "seed=1,2"]) == 0
    out = capsys.readouterr().out
    assert out.count("done before") == 1
    assert f"{jobs[0]}: done before" in out
    assert run("plan", [*arguments, "seed=1,2", "hydra.sweep.subdir=same"]) == 2
    assert "same is the folder of" in capsys.readouterr().err


def test_a_stopped_evaluation_of_a_sweep_is_resumed(tmp_path):
    world = ["layout=3x6", "reach=wide_hand", "instances=z3-5", "limit=10", "planner=straight_line"]
    arguments = ["-m", *world, "planners.straight_line.max_moves=20,30", f"hydra.sweep.dir={tmp_path}"]
    with ctrl_c_at_plan(5) as calls:
        assert run("evaluate", arguments) == 130
    assert len(calls) == 5, "no further job is started"
    (partial,) = tmp_path.glob("*/rows.part.csv")
    kept = partial.read_text(encoding="utf-8")
    assert run("evaluate", arguments) == 0
    assert (partial.parent / "rows.csv").read_text(encoding="utf-8").startswith(kept)
    assert len(list(tmp_path.glob("*/rows.csv"))) == 2


@pytest.mark.sim
def test_executions_have_a_folder_each_and_go_on(tmp_path, capsys):
    """A start again makes only the one that was killed."""
    arguments = ["-m", "scene=random", "obstacles=2", "video=off", "seed=1,2", f"hydra.sweep.dir={tmp_path}"]
    assert run("execute", arguments) == 0
    first, second = sorted(tmp_path.glob("*/execution.json"))
    (second.parent / "job.json").unlink()
    report = json.loads(second.read_text(encoding="utf-8"))
    second.write_text(json.dumps(report | {"finished": False, "success": False}), encoding="utf-8")
    before = first.stat().st_mtime_ns
    capsys.readouterr()
    assert run("execute", arguments) == 0
    assert json.loads(second.read_text(encoding="utf-8"))["success"]
    assert first.stat().st_mtime_ns == before
    assert capsys.readouterr().out.count("done before") == 1
    assert run("execute", [*arguments, "jitter_m=-1"]) == 2
    assert len([path for path in tmp_path.iterdir() if path.is_dir()]) == 2, "bad input leaves no folder"
