"""What the arm can follow: every lane of its reach, straight, on one branch, and touching nothing."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dore.layout import Layout
from dore.sim.collision import TABLE_OVERHANG_M, CollisionChecker, Standing
from dore.sim.config import Body, preset
from dore.sim.description import arm_files, slim_urdf
from dore.sim.frames import hand_pose, lane
from dore.sim.kinematics import LARGEST_STEP_RAD, ArmKinematics, Reached, Unreachable

LAYOUT = Layout.grid(3, 6, 0.12, 0.50)
ARM = preset("arm/panda_slim")
STAGING_X = LAYOUT.front_m - ARM.staging_m
CLEARANCE_M = 0.10
"""r of reach=panda_slim."""
WIDEST = Body("cuboid", 0.025, 0.15)


@pytest.fixture(scope="module")
def kinematics() -> ArmKinematics:
    return ArmKinematics(arm_files(visuals=False), ARM)


def follow(kinematics: ArmKinematics, cell: int, direction_deg: float, height_m: float) -> tuple[Reached, np.ndarray]:
    """Where a lane begins, and its joint path."""
    way = lane(LAYOUT.cells[cell], direction_deg, STAGING_X)
    ready = kinematics.ready(STAGING_X)
    _, staged = kinematics.line(ready, np.array([*way.staging_xy, height_m]), way.heading_rad)
    path, _ = kinematics.line(staged, np.array([*way.cell_xy, height_m]), way.heading_rad)
    return staged, path


def test_every_lane_of_every_cell_can_be_followed(kinematics):
    """Cells of the left half stand for their mirror images; each direction of the fan that the heading limit allows."""
    followed = 0
    for cell in (c for c in range(LAYOUT.n_cells) if LAYOUT.cells[c][1] > 0):
        for direction in range(-30, 31, 6):
            way = lane(LAYOUT.cells[cell], direction, STAGING_X)
            assert abs(math.degrees(way.heading_rad)) <= ARM.heading_limit_deg
            assert abs(way.staging_xy[1]) <= ARM.lateral_limit_m
            staged, path = follow(kinematics, cell, direction, ARM.grasp_height_m)
            steps = np.abs(np.diff(np.vstack([staged.joints, path]), axis=0))
            assert steps.max() < LARGEST_STEP_RAD
            followed += 1
    assert followed == 9 * 11


def test_lanes_are_straight_in_space(kinematics):
    staged, path = follow(kinematics, 12, 20.0, ARM.grasp_height_m)
    at = np.array([kinematics.tool(joints)[:3, 3] for joints in path])
    along = (at[-1] - staged.xyz) / np.linalg.norm(at[-1] - staged.xyz)
    off = (at - staged.xyz) - np.outer((at - staged.xyz) @ along, along)
    assert np.linalg.norm(off, axis=1).max() < 5e-4


def test_forward_kinematics_undoes_inverse_kinematics(kinematics):
    xyz, heading = np.array([0.7, -0.2, 0.12]), math.radians(-25)
    joints = kinematics.solve(xyz, heading, kinematics.ready(STAGING_X).joints)
    assert np.allclose(kinematics.tool(joints), hand_pose(xyz, heading, ARM.tilt_rad), atol=2e-3)


def test_joints_depend_on_the_pose_and_not_on_the_way_there(kinematics):
    goal, ready = np.array([0.7, 0.2, 0.1]), kinematics.ready(STAGING_X)
    _, direct = kinematics.line(ready, goal, 0.2)
    _, aside = kinematics.line(ready, np.array([STAGING_X, -0.3, 0.1]), -0.5)
    _, back = kinematics.line(aside, np.array([STAGING_X, 0.1, 0.1]), 0.3)
    _, detour = kinematics.line(back, goal, 0.2)
    assert np.abs(direct.joints - detour.joints).max() < 5e-3


def test_out_of_reach_is_said_with_the_place(kinematics):
    with pytest.raises(Unreachable, match=r"0\.9\d+, 0\.000"):
        kinematics.line(kinematics.ready(STAGING_X), np.array([1.4, 0.0, 0.1]), 0.0)


def test_no_lane_that_the_clearance_allows_touches_an_object(kinematics):
    """The planners' rule against coal: one obstacle, turned at its widest, on any cell that leaves the lane free."""
    checker = CollisionChecker(kinematics, [WIDEST, WIDEST], LAYOUT.front_m - TABLE_OVERHANG_M)
    checked = 0
    for cell, direction in ((13, -30), (13, 0), (13, 24), (14, -6), (14, 9), (8, -18), (1, 0), (0, 30), (12, -24)):
        x, y = LAYOUT.cells[cell]
        _, path = follow(kinematics, cell, direction, ARM.grasp_height_m)
        for other, (ox, oy) in enumerate(LAYOUT.cells):
            distance = math.hypot(ox - x, oy - y)
            if other == cell or _covered(math.atan2(oy - y, ox - x), distance, x, y, direction):
                continue
            standing = {0: Standing((x, y)), 1: Standing((ox, oy), math.radians(45))}
            for held, reached_for in ((None, 0), (0, None)):
                here = {1: standing[1]} if held == 0 else standing
                assert checker.first_contact(path, here, held, reached_for) is None, (cell, direction, other)
            checked += 1
    assert checked > 100


def _covered(bearing: float, distance: float, x: float, y: float, direction_deg: float) -> bool:
    off = abs(math.remainder(bearing - math.atan2(-y, -x) - math.radians(direction_deg), math.tau))
    return off <= (math.asin(CLEARANCE_M / distance) if distance > CLEARANCE_M else math.pi / 2)


def test_contact_names_the_part_and_the_object(kinematics):
    checker = CollisionChecker(kinematics, [WIDEST, WIDEST], LAYOUT.front_m - TABLE_OVERHANG_M)
    _, path = follow(kinematics, 14, 0.0, ARM.grasp_height_m)
    x, y = LAYOUT.cells[14]
    contact = checker.first_contact(path, {0: Standing((x, y)), 1: Standing((x - 0.12, y))}, None, 0)
    assert contact is not None
    assert contact.body == 1
    assert "finger" in contact.part or contact.part == "hand"


def test_a_hand_too_low_touches_the_table(kinematics):
    checker = CollisionChecker(kinematics, [WIDEST], LAYOUT.front_m - TABLE_OVERHANG_M)
    _, path = follow(kinematics, 8, 0.0, 0.005)
    contact = checker.first_contact(path, {}, None, None)
    assert contact is not None
    assert contact.other == "table"
    assert contact.body is None


def test_description_of_another_panda_is_refused():
    with pytest.raises(RuntimeError, match="panda_hand"):
        slim_urdf("<robot/>", arm_files(visuals=False).parent)


def test_description_is_written_once_and_without_visuals_where_asked():
    file = arm_files(visuals=False)
    assert file == arm_files(visuals=False)
    assert "<visual>" not in file.read_text()
    assert "<visual>" in arm_files(visuals=True).read_text()
    assert file.with_suffix(".srdf").exists()
