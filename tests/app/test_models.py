"""Several models in one evaluation: labelled, paired, and grouped over their seeds."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from dore.app.models import models_of
from dore.errors import InputError
from dore.report.rows import read_rows
from tests.commands import TINY, run

QUICK = [*TINY, "training.max_episodes=40"]


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> Path:
    """Two seeds of one structure, as a sweep leaves them, one seed of another structure, and one of another layout."""
    root = tmp_path_factory.mktemp("runs")
    for folder, *more in (
        ("mine/agent-sequential_seed-0", "seed=0"),
        ("mine/agent-sequential_seed-1", "seed=1"),
        ("mine/agent-single_seed-1", "seed=1", "agent=single"),
        ("other/agent-single_seed-1", "seed=1", "agent=single", "layout.rows=4"),
    ):
        assert run("train", [*QUICK, *more, f"run_dir={root / folder}"]) == 0
    return root


def test_a_sweep_and_the_shipped_one(runs, tmp_path, capsys):
    wanted = [f"model=[{runs / 'mine'},null]", "planner=[learned,straight_line]", f"run_dir={tmp_path / 'run'}"]
    assert run("evaluate", [*wanted, "limit=10"]) == 0
    names = ["learned agent-sequential_seed-0", "learned agent-sequential_seed-1", "learned agent-single_seed-1"]
    rows = read_rows(tmp_path / "run" / "rows.csv")
    assert list(rows.planner.unique()) == [*names, "learned shipped", "straight_line"]
    assert (rows.groupby("planner").obstacles.agg(tuple).nunique(), len(rows)) == (1, 50)
    over_seeds = capsys.readouterr().out.split("over seeds")[1].splitlines()[2:]
    (line,) = [one for one in over_seeds if one.startswith("learned")]
    assert line.split()[:3] == ["learned", "agent-sequential", "2"]
    solved = [100 * (rows[rows.planner == name].status == "solved").mean() for name in names[:2]]
    assert f"{sum(solved) / 2:.1f} (" in line
    assert f"[{min(solved):.1f}, {max(solved):.1f}]" in line
    assert run("evaluate", [f"resume={tmp_path / 'run'}"]) == 0
    assert "over seeds" in capsys.readouterr().out


def test_labels_and_groups(runs):
    mine, other = runs / "mine", runs / "other" / "agent-single_seed-1"
    assert [(one.label, one.group) for one in models_of([str(mine), None])] == [
        ("agent-sequential_seed-0", "agent-sequential"),
        ("agent-sequential_seed-1", "agent-sequential"),
        ("agent-single_seed-1", "agent-single_seed-1"),
        ("shipped", "shipped"),
    ]
    same_name = models_of([str(mine / "agent-single_seed-1"), str(other / "model.safetensors")])
    assert [one.label for one in same_name] == ["mine/agent-single_seed-1", "other/agent-single_seed-1"]
    assert [one.label for one in models_of(str(other))] == [""], "a single model needs no label"


def test_what_cannot_be_compared_is_one_line(runs, tmp_path, capsys):
    mine, other = runs / "mine", runs / "other"
    for model, says in (
        ("[]", "model: got an empty list"),
        (f"[{other},{other}]", "model: other/agent-single_seed-1 is given twice"),
        (f"[{mine},{other}]", "learned on another layout, want layout=NAME"),
        (str(tmp_path), f"model: {tmp_path} holds no model.safetensors, and no runs with one"),
    ):
        assert run("evaluate", [f"model={model}", "planner=learned", "limit=2"]) == 2
        err = capsys.readouterr().err
        assert says in err
        assert err.count("\n") == 1
    assert run("plan", [f"model={mine}", "planner=learned"]) == 2
    assert "want one" in capsys.readouterr().err


def test_an_unfinished_run_is_said(runs, capsys):
    done = runs / "mine" / "agent-single_seed-1" / "done.json"
    text = done.read_text(encoding="utf-8")
    done.unlink()
    try:
        assert len(models_of(str(runs / "mine"))) == 3
    finally:
        done.write_text(text, encoding="utf-8")
    assert "agent-single_seed-1: not finished, its best so far" in capsys.readouterr().err


def test_two_planners_of_one_class_are_called_by_their_keys(tmp_path):
    other = json.dumps({"_target_": "dore.planners.straight_line.StraightLine", "start_x_m": 0.0, "start_y_m": 0.1,
                        "corridor_m": None, "avoid_corridors": True, "max_moves": 30}).replace('"', "")  # fmt: skip
    world = ["layout=3x6", "reach=wide_hand", "instances=z3-5", "limit=3", "planner=straight_line"]
    assert run("evaluate", [*world, f"+planners.other={other}", f"run_dir={tmp_path / 'run'}"]) == 0
    assert set(read_rows(tmp_path / "run" / "rows.csv").planner) == {"straight_line", "other"}


def test_no_model_at_all():
    with pytest.raises(InputError, match="model: got 3, want a path"):
        models_of([3])
