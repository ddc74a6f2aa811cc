"""Scene and plan files: what is written comes back, what is wrong is one clear line, nothing is half-written."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from pathlib import Path

import pytest
import torch

from dore.errors import InputError
from dore.files import atomic_write
from dore.world.files import read_plan, read_scene, write_plan
from dore.world.layout import Layout
from dore.world.plan import Plan, PlanError, PlanFile, Status
from dore.world.problem import Problem, Scene
from dore.world.reach import Reach
from tests.drawings import PUBLISHED
from tests.world.test_plan import FIG_7, FIG_7_PLAN, REACH

FILE = PlanFile(Problem(FIG_7, REACH), FIG_7_PLAN)


def test_a_plan_comes_back(path: Path) -> None:
    back = read_plan(path)
    assert back.plan == FIG_7_PLAN
    assert back.scene.obstacles == FIG_7.obstacles
    assert back.scene.target == FIG_7.target
    assert back.reach.to_dict() == REACH.to_dict()
    torch.testing.assert_close(back.scene.layout.centres, FIG_7.layout.centres, rtol=0, atol=1e-9)
    write_plan(path, back)
    assert read_plan(path).plan == FIG_7_PLAN


def test_files_of_before_there_were_lower_bounds_and_metres_are_read(path: Path) -> None:
    bounded = dataclasses.replace(FIG_7_PLAN, status=Status.GAVE_UP, target_direction_deg=None, lower_bound=5)
    write_plan(path, PlanFile(FILE.problem, bounded))
    assert read_plan(path).plan == bounded
    data = json.loads(path.read_text())
    del data["lower_bound"], data["base_frame"]
    path.write_text(json.dumps(data))
    assert read_plan(path).plan == dataclasses.replace(bounded, lower_bound=None)


def test_files_hold_the_papers_ids(path: Path) -> None:
    data = json.loads(path.read_text())
    assert (data["format"], data["status"], data["planner"]) == ("dore-plan/1", "solved", "test")
    assert (data["obstacles"], data["target"]) == ([1, 3, 7, 9, 13, 16], 15)
    assert [(move["pick"], move["place"]) for move in data["moves"]] == [(16, 18), (3, 12), (9, 17)]
    assert data["layout"] == {"rows": 3, "cols": 6, "cell_m": 0.12, "front_m": 0.57}
    assert data["reach"] == PUBLISHED
    assert "optimal_moves" not in data


def test_a_plan_file_can_be_carried_out_from_metres_and_degrees_alone(path: Path) -> None:
    """The hand that moves towards a cell along its heading comes from the base's side, past no object."""
    frame = json.loads(path.read_text())["base_frame"]
    assert frame["axes"] == "x forward, y left, origin at the base; headings counter-clockwise from x"
    first, picked = frame["moves"][0]["pick"], FIG_7_PLAN.moves[0].pick
    x, y = first["centre_m"]
    assert (x, y) == pytest.approx(FIG_7.layout.cells[picked], abs=1e-6)
    heading = math.radians(first["heading_deg"])
    assert math.hypot(x - 0.3 * math.cos(heading), y - 0.3 * math.sin(heading)) < math.hypot(x, y)
    for other in {*FIG_7.obstacles, FIG_7.target} - {picked}:
        dx, dy = x - FIG_7.layout.cells[other][0], y - FIG_7.layout.cells[other][1]
        before = dx * math.cos(heading) + dy * math.sin(heading) > 0
        assert not before or abs(dx * math.sin(heading) - dy * math.cos(heading)) >= REACH.clearance_m - 1e-6
    assert frame["target"]["centre_m"] == pytest.approx(FIG_7.layout.cells[FIG_7.target], abs=1e-6)


def test_metres_that_contradict_the_cells_are_refused(path: Path) -> None:
    data = json.loads(path.read_text())
    data["base_frame"]["moves"][1]["place"]["heading_deg"] += 2
    path.write_text(json.dumps(data))
    with pytest.raises(
        InputError, match=r"base_frame\.moves\[1\]\.place: got .*, want .*, as cells and directions say"
    ):
        read_plan(path)
    del data["base_frame"]  # As version 0.1 wrote it.
    path.write_text(json.dumps(data))
    assert read_plan(path).plan == FIG_7_PLAN


@pytest.mark.parametrize("status", [Status.UNSOLVABLE, Status.GAVE_UP])
def test_plans_without_a_solution_and_irregular_layouts_come_back(tmp_path: Path, status: Status) -> None:
    layout = Layout(((0.5, 0.1), (0.5, -0.1), (0.68, 0.02)), 0.12)
    reach = Reach(layout, 0.1, 20.0, 10, staging_m=0.1, lateral_limit_m=0.3, max_yaw_deg=40.0)
    plan = Plan(status, (), None, "exact", 1.25, optimal_moves=None)
    write_plan(tmp_path / "plan.json", PlanFile(Problem(Scene(layout, (0,), 2), reach), plan))
    back = read_plan(tmp_path / "plan.json")
    assert back.plan == plan
    assert back.reach.to_dict() == reach.to_dict()
    assert back.scene == Scene(layout, (0,), 2)


def test_a_scene_comes_back_and_a_plans_scene_will_do(tmp_path: Path, path: Path) -> None:
    fields = json.loads(path.read_text())
    scene = {"format": "dore-scene/1", **{key: fields[key] for key in ("layout", "obstacles", "target")}}
    (tmp_path / "scene.json").write_text(json.dumps(scene))
    for file in (tmp_path / "scene.json", path):
        assert read_scene(file).obstacles == FIG_7.obstacles
        assert read_scene(file).target == FIG_7.target
    with pytest.raises(InputError, match="want dore-plan/1"):
        read_plan(tmp_path / "scene.json")


def test_a_plan_that_does_not_replay_is_not_written(path: Path) -> None:
    before = path.read_bytes()
    cut = Plan(Status.SOLVED, FIG_7_PLAN.moves[:2], FIG_7_PLAN.target_direction_deg, "test", 0.0)
    with pytest.raises(PlanError, match=r"^target corridor"):
        write_plan(path, PlanFile(Problem(FIG_7, REACH), cut))
    assert path.read_bytes() == before


def test_a_write_that_fails_leaves_the_old_file_and_no_other(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = path.read_bytes()

    def full_disk(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(OSError, match="No space"):
        write_plan(path, FILE)
    monkeypatch.setattr(json, "dump", full_disk)
    with pytest.raises(OSError, match="No space"):
        write_plan(path.with_name("other.json"), FILE)
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]


def test_a_block_that_breaks_off_leaves_nothing(tmp_path: Path) -> None:
    def write_half() -> None:
        with atomic_write(tmp_path / "file") as file:
            file.write("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_half()
    assert list(tmp_path.iterdir()) == []
