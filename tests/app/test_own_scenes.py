"""Scenes of one's own as a test set, and the instances of an evaluation taken again."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from dore.errors import InputError
from dore.report.rows import read_rows
from dore.world.files import read_plan
from dore.world.scene_files import read_scenes
from tests.commands import run

LAYOUT = {"rows": 3, "cols": 6, "cell_m": 0.12, "front_m": 0.5}
SCENES = [([16, 3, 9, 7, 13, 1], 15), ([1, 2], 9), ([9, 3, 15, 8, 10], 14), ([], 4)]
"""The second and the last target are accessible at the start."""


def scene(obstacles: list[int], target: int, **layout: float) -> dict[str, object]:
    return {"format": "dore-scene/1", "layout": LAYOUT | layout, "obstacles": obstacles, "target": target}


@pytest.fixture
def scenes(tmp_path: Path) -> Path:
    path = tmp_path / "scenes.json"
    path.write_text(json.dumps([scene(*one) for one in SCENES]), encoding="utf-8")
    return path


def evaluate(path: Path, folder: Path, *more: str) -> int:
    file = ("instances=file", f"instances.path={path}", "reach=panda_slim", "planner=exact")
    return run("evaluate", [*file, f"run_dir={folder}", *more])


def test_a_list_is_evaluated_and_its_instances_are_planned_again(scenes, tmp_path, capsys, monkeypatch):
    assert evaluate(scenes, tmp_path / "run") == 0
    assert "2 of 4 targets are accessible at the start: solved in no move" in capsys.readouterr().out
    rows = read_rows(tmp_path / "run" / "rows.csv")
    assert list(zip(rows.obstacles, rows.target, strict=True)) == [
        (" ".join(map(str, sorted(obstacles))), str(target)) for obstacles, target in SCENES
    ]
    assert set(rows.layout) == {"3 x 6 cells of 0.12 m from x = 0.5 m"}
    out = tmp_path / "again.json"
    assert run("plan", [f"scene={tmp_path / 'run'}", "instance=3", "planner=exact", f"out={out}"]) == 0
    plan = read_plan(out)
    assert (plan.scene.obstacles, plan.scene.target) == ((2, 7, 8, 9, 14), 13)
    assert len(plan.plan.moves) == rows.moves[2]
    assert plan.reach.clearance_m == 0.1, "that of the evaluation"
    monkeypatch.chdir("/")
    assert run("evaluate", [f"resume={tmp_path / 'run'}"]) == 0


@pytest.mark.sim
def test_an_instance_is_executed(scenes, tmp_path):
    assert evaluate(scenes, tmp_path / "run", "limit=1") == 0
    where = [f"scene={tmp_path / 'run'}", "instance=1", "video=off", f"run_dir={tmp_path / 'executed'}"]
    assert run("execute", where) == 0
    report = json.loads((tmp_path / "executed" / "execution.json").read_text(encoding="utf-8"))
    assert report["success"]


def test_a_folder_and_a_single_file_are_scenes_too(tmp_path):
    for name, one in zip("ba", SCENES, strict=False):
        (tmp_path / f"{name}.json").write_text(json.dumps(scene(*one)), encoding="utf-8")
    assert [found.target for found in read_scenes(tmp_path)] == [8, 14]
    assert [found.target for found in read_scenes(tmp_path / "b.json")] == [14]


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ([], "an empty list, want scenes"),
        ([scene([1], 2), scene([1], 1)], "scene 2: scene.target: cell 1 holds an obstacle"),
        ([scene([1], 2), {"format": "x"}], "scene 2: format 'x', want"),
        ([scene([1], 2), scene([1], 2, rows=4)], "instances: scene 2 has 4 x 6 cells"),
        ([scene([1], 2), scene([1], 2)], "number 2 has the board and the target of an earlier one"),
    ],
)
def test_bad_lists_are_one_line(tmp_path, capsys, content, says):
    (tmp_path / "scenes.json").write_text(json.dumps(content), encoding="utf-8")
    assert evaluate(tmp_path / "scenes.json", tmp_path / "run") == 2
    assert says in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_what_cannot_be_taken_is_said(scenes, tmp_path, capsys):
    assert evaluate(scenes, tmp_path / "run") == 0
    capsys.readouterr()
    for command, arguments, says in (
        ("plan", [f"scene={scenes}"], "instance: not given, want 1 to 4"),
        ("plan", [f"scene={scenes}", "instance=5"], "instance: got 5, want 4 at most"),
        ("plan", [f"scene={tmp_path / 'run'}", "instance=5"], "instance: got 5, and"),
        ("plan", [f"scene={tmp_path / 'run'}"], "instance: got None, want a whole number"),
        ("plan", ["instance=3"], "want none with scene=random"),
        ("plan", ["instances=file", f"instances.path={scenes}"], "want scene=PATH instance=N"),
        ("evaluate", ["instances=file"], "instances.path: got None, want a path"),
        ("train", ["instances=file", f"instances.path={scenes}"], "scenes of one's own are for evaluations"),
    ):
        assert run(command, arguments) == 2
        err = capsys.readouterr().err
        assert says in err
        assert err.count("\n") == 1
    with pytest.raises(InputError, match=r"no \*\.json in this folder"):
        read_scenes(Path(__file__).parent)


def test_another_set_of_scenes_does_not_resume_an_evaluation(scenes, tmp_path, capsys):
    assert evaluate(scenes, tmp_path / "run") == 0
    rows = tmp_path / "run" / "rows.csv"
    rows.rename(rows.with_name("rows.part.csv"))
    scenes.write_text(json.dumps([scene(*one) for one in reversed(SCENES)]), encoding="utf-8")
    assert run("evaluate", [f"resume={tmp_path / 'run'}"]) == 2
    assert "is from another evaluation" in capsys.readouterr().err
