"""The arm's kinematics: straight lines on one branch, and contacts named; all corridors are in test_arm_reach.py."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dore.sim.config import Body, preset
from dore.sim.frames import TABLE_OVERHANG_M, corridor, hand_pose
from dore.sim.kinematics import (
    LARGEST_STEP_RAD,
    POSITION_TOLERANCE_M,
    WAYPOINT_M,
    WAYPOINT_RAD,
    ArmKinematics,
    Reached,
    Unreachable,
)
from dore.sim.motion.collision import CollisionChecker, Held, Standing
from dore.sim.scene.panda import slim_urdf
from dore.sim.urdf import arm_files
from dore.world.layout import Layout

LAYOUT = Layout.grid(3, 6, 0.12, 0.50)
ARM = preset("arm/panda_slim")
STAGING_X = LAYOUT.front_m - ARM.staging_m
WIDEST = Body("cuboid", 0.025, 0.15)


@pytest.fixture(scope="module")
def kinematics() -> ArmKinematics:
    return ArmKinematics(arm_files(visuals=False), ARM)


def follow(kinematics: ArmKinematics, cell: int, direction_deg: float, height_m: float) -> tuple[Reached, np.ndarray]:
    """Where a corridor begins, and its joint path."""
    way = corridor(LAYOUT.cells[cell], direction_deg, STAGING_X)
    ready = kinematics.ready(STAGING_X)
    _, staged = kinematics.line(ready, np.array([*way.staging_xy, height_m]), way.heading_rad)
    path, _ = kinematics.line(staged, np.array([*way.cell_xy, height_m]), way.heading_rad)
    return staged, path


def test_a_corridor_is_followed_in_small_steps(kinematics):
    staged, path = follow(kinematics, 6, 30.0, ARM.grasp_height_m)
    assert np.abs(np.diff(np.vstack([staged.joints, path]), axis=0)).max() < LARGEST_STEP_RAD / 2
    assert (path[:, 2] == 0.0).all()  # the joint that is held, so that a pose has one posture


def test_corridors_are_straight_in_space(kinematics):
    staged, path = follow(kinematics, 12, 20.0, ARM.grasp_height_m)
    at = np.array([kinematics.tool(joints)[:3, 3] for joints in path])
    along = (at[-1] - staged.xyz) / np.linalg.norm(at[-1] - staged.xyz)
    off = (at - staged.xyz) - np.outer((at - staged.xyz) @ along, along)
    assert np.linalg.norm(off, axis=1).max() < 5e-4


def test_lines_end_where_they_should_and_never_step_too_far(kinematics):
    ready = kinematics.ready(STAGING_X)
    for xyz, heading in (([0.7, 0.1, 0.1], 0.0), ([STAGING_X + 0.02, 0.0, ARM.grasp_height_m], 0.5)):
        path, end = kinematics.line(ready, np.array(xyz), heading)
        poses = [kinematics.reached(joints) for joints in (ready.joints, *path)]
        assert np.allclose(poses[-1].xyz, xyz, atol=POSITION_TOLERANCE_M)
        assert poses[-1].heading_rad == pytest.approx(heading, abs=2e-3)
        assert (end.xyz == xyz).all()
        steps = np.diff([pose.xyz for pose in poses], axis=0)
        assert np.linalg.norm(steps, axis=1).max() <= WAYPOINT_M + 2 * POSITION_TOLERANCE_M
        turns = np.abs(np.diff([pose.heading_rad for pose in poses]))
        assert turns.max() <= WAYPOINT_RAD + 4e-3


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


def test_what_is_carried_meets_objects_table_and_the_arm(kinematics):
    """Alone, so that nothing else of the arm is what is met."""
    checker = CollisionChecker(kinematics, [WIDEST, WIDEST], LAYOUT.front_m - TABLE_OVERHANG_M)
    _, path = follow(kinematics, 8, 0.0, ARM.grasp_height_m + ARM.lift_m)
    assert checker.first_contact(path, {}, held=Held(0)) is None
    # An object beside the end of the corridor, which the carried one overlaps and the hand does not.
    x, y = LAYOUT.cells[8]
    contact = checker.first_contact(path, {1: Standing((x + 0.049, y))}, held=Held(0))
    assert contact is not None
    assert (contact.part, contact.body) == ("carried object", 1)
    _, low = follow(kinematics, 8, 0.0, ARM.grasp_height_m - 0.02)
    assert checker.first_contact(low, {}) is None
    contact = checker.first_contact(low, {}, held=Held(0))
    assert contact is not None
    assert (contact.part, contact.other) == ("carried object", "table")
    # As tall as the forearm is high, and held below it.
    tall = CollisionChecker(kinematics, [Body("cuboid", 0.025, 0.45)], LAYOUT.front_m - TABLE_OVERHANG_M)
    assert tall.first_contact(path, {}, held=Held(0)) is None
    contact = tall.first_contact(path, {}, held=Held(0, along_m=-0.25))
    assert contact is not None
    assert (contact.part, contact.other) == ("carried object", "forearm")


def test_an_arm_folded_onto_itself_is_a_contact(kinematics):
    checker = CollisionChecker(kinematics, [WIDEST], LAYOUT.front_m - TABLE_OVERHANG_M)
    folded = np.array([[-0.29, 1.04, 0.0, -2.92, -0.55, 0.73, -2.37]])
    contact = checker.first_contact(folded, {})
    assert contact is not None
    assert (contact.part, contact.other) == ("base", "forearm")


def test_description_of_another_panda_is_refused():
    with pytest.raises(RuntimeError, match="panda_hand"):
        slim_urdf("<robot/>")


def test_description_is_written_once_and_without_visuals_where_asked():
    file = arm_files(visuals=False)
    assert file == arm_files(visuals=False)
    assert "<visual>" not in file.read_text()
    assert "<visual>" in arm_files(visuals=True).read_text()
    assert file.with_suffix(".srdf").exists()


def test_a_jump_to_another_branch_is_refused(kinematics, monkeypatch):
    """Where neighbouring points of a line have joints far apart, the arm would swing."""
    ready, solve = kinematics.ready(STAGING_X), kinematics.solve

    def jumping(xyz: np.ndarray, *given: object) -> np.ndarray:
        return solve(xyz, *given) + (LARGEST_STEP_RAD + 0.05) * (xyz[0] > 0.6)

    monkeypatch.setattr(kinematics, "solve", jumping)
    with pytest.raises(Unreachable, match=r"change its branch near \(0\.6\d+, 0\.000\)"):
        kinematics.line(ready, np.array([0.7, 0.0, 0.1]), 0.0)
