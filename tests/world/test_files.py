"""Scene and plan files: what is written comes back, what is wrong is one clear line, nothing is half-written."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

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


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A good plan file."""
    write_plan(tmp_path / "plan.json", FILE)
    return tmp_path / "plan.json"


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


Change = Callable[[dict[str, Any]], object]


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda d: d.update(format="dore-plan/2"), "format 'dore-plan/2', want dore-plan/1"),
        (lambda d: d.pop("format"), "format None"),
        (lambda d: d.update(obstacles=[16, 3, 9, 7, 16]), "scene.obstacles: two objects on cell 16"),
        (lambda d: d.update(obstacles=[19]), "scene.obstacles: id 19, want 1 to 18"),
        (lambda d: d.update(obstacles=[0]), r"obstacles\[0\]: got 0, want a whole number of at least 1"),
        (lambda d: d.update(obstacles=["3"]), r"obstacles\[0\]: got '3', want a whole number"),
        (lambda d: d.update(obstacles=[True]), r"obstacles\[0\]: got True, want a whole number"),
        (lambda d: d.update(obstacles={"1": 2}), "obstacles: got {'1': 2}, want a list"),
        (lambda d: d.pop("obstacles"), "obstacles: not given"),
        (lambda d: d.update(target=16), "scene.target: cell 16 holds an obstacle"),
        (lambda d: d.update(target=99), "scene.target: id 99, want 1 to 18"),
        (lambda d: d.update(target=1.5), "target: got 1.5, want a whole number"),
        (lambda d: d.pop("target"), "target: not given"),
        (lambda d: d.update(layout=None), "layout: got None"),
        (lambda d: d["layout"].update(rows=0), "layout.rows: got 0"),
        (lambda d: d["layout"].update(cell_m=-1), "layout.cell_m: got -1"),
        (lambda d: d.update(reach=None), "reach: got None"),
        (lambda d: d["reach"].update(clearance_m=0), "reach.clearance_m: got 0"),
        (lambda d: d["reach"].update(colour=1), "reach.colour: no such key; want clearance_m, "),
        (lambda d: d["reach"].pop("n_sectors"), "reach.n_sectors: not given"),
        (lambda d: d.update(status="done"), "status: got 'done', want one of solved, unsolvable, gave_up"),
        (lambda d: d.update(status="gave_up"), "plan: status gave_up and target direction"),
        (lambda d: d.update(moves=None), "moves: got None, want a list"),
        (lambda d: d.update(moves=[3]), r"moves\[0\]: got 3, want an object"),
        (lambda d: d["moves"][0].pop("pick"), r"moves\[0\].pick: not given"),
        (lambda d: d["moves"][0].update(place="x"), r"moves\[0\].place: got 'x', want a whole number"),
        (
            lambda d: d["moves"][0].update(pick_direction_deg="x"),
            r"moves\[0\].pick_direction_deg: got 'x', want a number",
        ),
        (lambda d: d["moves"][0].update(place_direction_deg=None), r"moves\[0\].place_direction_deg: got None"),
        (lambda d: d.update(target_direction_deg=[]), "target_direction_deg: got"),
        (lambda d: d.update(planning_s="long"), "planning_s: got 'long'"),
        (lambda d: d.update(optimal_moves="few"), "optimal_moves: got 'few'"),
        (lambda d: d.update(obstacle=[1]), r"obstacle: no such key \(did you mean obstacles\?\)"),
        (
            lambda d: d["moves"][0].update(pik=1),
            r"moves\[0\].pik: no such key \(did you mean pick\?\); want pick, place",
        ),
        (lambda d: d["layout"].update(cell_m=120), r"layout.cell_m: got 120.0, want .* at most 1 \(metres\)"),
        (lambda d: d["layout"].update(cell_m=12.0), r"layout.cell_m: got 12.0, want .* at most 1 \(metres\)"),
        (lambda d: d["layout"].update(cell_m=0.03), r"layout.cell_m: got 0.03, want a finite number above 0.07"),
        (lambda d: d["layout"].update(front_m=570), r"layout.front_m: got 570.*\(metres\)"),
        (lambda d: d["layout"].update(fron_m=0.57), r"layout.fron_m: no such key \(did you mean front_m\?\)"),
        (lambda d: d["reach"].update(clearance_m=142), r"reach.clearance_m: got 142.0, want .*\(metres\)"),
        (lambda d: d.update(optimal_moves=4), "plan.optimal_moves: got 4, and the plan has 3 moves"),
        (lambda d: d.update(optimal_moves=10**30), "got a number of 31 digits"),
        (lambda d: d.update(status="unsolvable", target_direction_deg=None), "plan: status unsolvable with 3 moves"),
        (lambda d: d.update(planning_s=-1.0), "planning_s: got -1.0"),
        (lambda d: d["moves"].pop(), "target corridor at .* is blocked by the object on cell 9"),
        (lambda d: d["moves"].reverse(), r"move 1 \(9 to 17\)"),
        (lambda d: d["moves"][1].update(pick=4), r"move 2 \(4 to 12\): no obstacle on cell 4"),
        (lambda d: d["moves"][1].update(place=19), r"move 2 \(3 to 19\): place id 19, want 1 to 18"),
        (lambda d: d["moves"][0].update(pick_direction_deg=90), r"move 1 \(16 to 18\): pick direction 90 deg"),
    ],
)
def test_a_bad_plan_file_is_one_line(path: Path, change: Change, why: str) -> None:
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))
    with pytest.raises(InputError, match=rf"plan\.json: {why}") as error:
        read_plan(path)
    assert "\n" not in str(error.value)


def test_a_key_given_twice_is_one_line(path: Path) -> None:
    text = path.read_text()
    path.write_text(text.replace('"target": 15', '"target": 15, "target": 2', 1))
    with pytest.raises(InputError, match=r"plan\.json: target: given twice, want it once"):
        read_scene(path)


@pytest.mark.parametrize(("encoding", "read"), [("utf-8-sig", True), ("utf-16", False), ("utf-32", False)])
def test_a_byte_order_mark_is_read_and_other_encodings_are_refused(path: Path, encoding: str, read: bool) -> None:
    path.write_text(path.read_text(), encoding=encoding)
    if read:
        assert read_plan(path).plan == FIG_7_PLAN
    else:
        with pytest.raises(InputError, match=r"plan\.json: cannot be read as JSON \(not in UTF-8\)"):
            read_plan(path)


def test_cells_nearer_than_they_are_wide_are_refused(tmp_path: Path) -> None:
    fields = {"format": "dore-scene/1", "obstacles": [1, 2], "target": 3}
    cells = {"cells": [[0.56, 0.0], [0.561, 0.0], [0.7, 0.0]], "cell_m": 0.12}
    (tmp_path / "scene.json").write_text(json.dumps({**fields, "layout": cells}))
    with pytest.raises(InputError, match=r"the centres of cells 1 and 2 are 0\.001 m apart, want 0\.07 m or more"):
        read_scene(tmp_path / "scene.json")


def test_every_cut_of_a_file_is_one_line(path: Path) -> None:
    text = path.read_text()
    for length in range(0, len(text) - 2, 37):
        path.write_text(text[:length])
        for read in (read_plan, read_scene):
            with pytest.raises(InputError, match="cannot be read as JSON") as error:
                read(path)
            assert "\n" not in str(error.value)


@pytest.mark.parametrize("data", [b"[]", b"3", b"null", b"\xff\xfe\x00", b"[" * 100_000])
def test_other_files_are_one_line(path: Path, data: bytes) -> None:
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"^[^\n]+plan.json: [^\n]+$"):
        read_plan(path)


def test_a_file_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    for read in (read_plan, read_scene):
        with pytest.raises(InputError, match="no such file"):
            read(tmp_path / "none.json")
        with pytest.raises(InputError, match="is a folder, want a file"):
            read(tmp_path)


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
