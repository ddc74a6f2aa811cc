"""Scene and plan files that are wrong: one clear line that names the field."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from dore.errors import InputError
from dore.world.files import read_plan, read_scene
from tests.world.test_plan import FIG_7_PLAN

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
