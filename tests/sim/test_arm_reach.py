"""Planning and executing agree: what the planners may ask for is what the arm can follow."""

from __future__ import annotations

import csv
import time
from pathlib import Path

import pytest
import torch

from dore.files import conf_dir
from dore.report import results
from dore.sim.config import preset
from dore.sim.kinematics import ArmKinematics
from dore.sim.motion.arm_reach import arm_reach, cells_out_of_reach, corridor_differences
from dore.sim.urdf import arm_files
from dore.world.board import unpack
from dore.world.files import read_plan
from dore.world.layout import Layout
from dore.world.reach import Reach
from scripts.measure_reach import Options, Surveyor, main
from scripts.program import run
from tests.report import fakes

LAYOUT = Layout.grid(3, 6, 0.12, 0.50)
ARM, OBJECTS = preset("arm/panda_slim"), preset("objects/mixed")


@pytest.fixture(scope="module")
def kinematics() -> ArmKinematics:
    return ArmKinematics(arm_files(visuals=False, arm=ARM), ARM)


@pytest.fixture(scope="module")
def reach(kinematics) -> Reach:
    return arm_reach(ARM, OBJECTS, LAYOUT, kinematics)


@pytest.fixture(scope="module")
def surveyor() -> Surveyor:
    return Surveyor(ARM, OBJECTS, LAYOUT)


def test_the_clearance_is_the_hand_the_widest_object_and_the_margin(kinematics, reach):
    assert kinematics.hand_half_width_m == pytest.approx(0.052)  # open by 0.04 each, 12 mm fingers
    assert OBJECTS.widest.radius_m == pytest.approx(0.025 * 2**0.5)
    least = 0.052 + 0.025 * 2**0.5 + ARM.corridor_margin_m
    assert least <= reach.clearance_m < least + 0.001


@pytest.mark.slow
def test_allowed_corridors_are_exactly_those_that_the_arm_follows(surveyor):
    """Every cell and sector of 3 x 6: none is allowed that the arm cannot follow, and none forbidden that it can."""
    followed = torch.tensor(
        [
            [not surveyor.corridor(cell, sector, others=False).why_not for sector in range(surveyor.reach.n_sectors)]
            for cell in range(LAYOUT.n_cells)
        ]
    )
    assert torch.equal(followed, surveyor.reach.allowed_sectors)


def check_no_contact(surveyor: Surveyor, corridors: list[list[int]]) -> int:
    """No allowed corridor touches an object on a cell that the rule leaves free; returns how many touch elsewhere."""
    found = surveyor.survey(corridors)
    assert found.corridors.followed.sum() == found.corridors.allowed.sum() == len(corridors)
    assert found.faults.empty
    assert ((found.objects["empty"] | found.objects.loaded) <= found.objects.blocked).all()
    return int(found.corridors.touched.sum())


def test_free_corridors_touch_nothing_a_sample(surveyor):
    sample = [[cell, sector] for cell in range(LAYOUT.n_cells) for sector in range(cell % 7, 60, 12)]
    assert check_no_contact(surveyor, sample) > 100


@pytest.mark.slow
def test_free_corridors_touch_nothing_all(surveyor):
    """Each of 1080 corridors with the widest object on each of the 17 other cells, empty and loaded."""
    assert check_no_contact(surveyor, surveyor.reach.allowed_sectors.nonzero().tolist()) > 1500


def test_a_clearance_too_small_is_found_out(surveyor):
    """The survey itself: with 1 cm less, it names corridors on which an object would be touched."""
    narrow = Surveyor(ARM, OBJECTS, LAYOUT)
    narrow.reach = Reach(LAYOUT, **{**surveyor.reach.to_dict(), "clearance_m": surveyor.reach.clearance_m - 0.01})
    found = narrow.survey([[7, sector] for sector in range(60)])
    assert len(found.faults) > 0
    touched = found.objects[(found.objects["empty"] | found.objects["loaded"]) == 1]
    unforeseen = touched[touched.blocked == 0]
    assert (unforeseen.off_mm > 1e3 * narrow.reach.clearance_m).all()
    counted = found.corridors.sum(numeric_only=True)
    assert counted.touched_not_blocked == len(unforeseen) > 0
    assert (counted.touched, counted.blocked) == (len(touched), found.objects.blocked.sum())
    assert unpack(narrow.reach.blockers, LAYOUT.n_cells)[7].sum() == counted.blocked


def test_a_layout_that_the_arm_only_half_reaches_and_its_page(tmp_path):
    """One column; its last cell is out of reach and yet allowed, which the exit code says."""
    assert run(main, Options, [f"out={tmp_path}", "rows=4", "cols=1", "arm_keys=[n_sectors=5]"]) == 1
    rows = list(csv.DictReader((tmp_path / "corridors" / "rows.csv").open()))
    assert len(rows) == 20
    assert all(row["allowed"] == "1" for row in rows)
    assert [row["followed"] for row in rows if row["cell"] == "1"] == ["1"] * 5
    assert [row["followed"] for row in rows if row["cell"] == "4"] == ["0"] * 5
    assert "no joint angles" in rows[-1]["why_not"]
    spec, docs = fakes.study("reach_panda_slim"), tmp_path / "docs"
    page = results.write_page(spec, "reach_panda_slim", tmp_path, docs).read_text(encoding="utf-8")
    followed = sum(row["followed"] == "1" for row in rows)
    assert f"| corridors to follow | 20 | 20 | {followed} | {20 - followed} | 0 |" in page
    assert "4 x 1 cells of 0.12 m" in page
    spec["folder"] = str(tmp_path / "gone")
    assert results.write_page(spec, "reach_panda_slim", None, docs).read_text(encoding="utf-8") == page


def test_a_plan_for_the_same_reach_differs_in_nothing(reach):
    assert corridor_differences(reach, reach) is None
    planned = read_plan(Path(conf_dir()) / "plans" / "fig7.json").reach
    assert corridor_differences(planned, reach) is None


def test_a_stricter_plan_and_other_sectors_are_no_difference(reach):
    assert corridor_differences(Reach(LAYOUT, 0.142, 15.0, 30), reach) is None
    assert corridor_differences(Reach(LAYOUT, 0.10, 30.0, 61), reach) is None


def test_corridors_outside_the_arms_fan_and_limits_are_named(reach):
    words = corridor_differences(Reach(LAYOUT, 0.10, 40.0, 9), reach)
    assert words == "36 of its 162 corridors (cells 1-18) are not this arm's"
    strict = Reach(LAYOUT, **{**reach.to_dict(), "lateral_limit_m": 0.2})
    words = corridor_differences(reach, strict)
    assert words is not None
    assert "cells 1-2, 5-8, 11-18" in words


def test_corridors_with_fewer_blocking_cells_are_named(reach):
    words = corridor_differences(Reach(LAYOUT, 0.095, 30.0, 60), reach)
    assert words is not None
    assert words.endswith("of its 1080 corridors (cells 1-18) have fewer blocking cells than this arm needs empty")


def test_far_cells_are_named_and_quickly(kinematics, reach):
    away = Layout.grid(3, 6, 0.12, 0.66)
    seconds = {}
    for layout, wanted in ((LAYOUT, ()), (away, tuple(range(12, 18)))):
        started = time.process_time()
        assert cells_out_of_reach(layout, arm_reach(ARM, OBJECTS, layout, kinematics), kinematics) == wanted
        seconds[layout] = time.process_time() - started
    assert max(seconds.values()) < 5.0  # CPU seconds, of a busy machine too
    deep = Layout.grid(6, 6, 0.12, 0.50)
    out = cells_out_of_reach(deep, arm_reach(ARM, OBJECTS, deep, kinematics), kinematics)
    assert set(range(24, 36)) <= set(out)
    assert not set(range(18)) & set(out)


def test_all_cells_are_out_of_reach_where_the_arm_cannot_even_begin(kinematics):
    away = Layout.grid(1, 2, 0.12, 1.5)
    assert cells_out_of_reach(away, arm_reach(ARM, OBJECTS, away, kinematics), kinematics) == (0, 1)
