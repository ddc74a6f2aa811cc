"""Cells to metres to hand poses, and joint paths to commands in time: plain geometry, no simulator."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from dore.errors import InputError
from dore.sim.config import Body, preset
from dore.sim.frames import corridor, hand_pose, inside, pixels_of, sight_lines, turned
from dore.sim.kinematics import timed
from dore.world.layout import Layout


def test_corridor_at_zero_degrees_points_away_from_the_base():
    way = corridor((0.8, 0.3), 0.0, staging_x=0.43)
    assert way.heading_rad == pytest.approx(math.atan2(0.3, 0.8))
    assert way.staging_xy == pytest.approx((0.43, 0.43 * 0.3 / 0.8))


@pytest.mark.parametrize("direction_deg", [-30.0, -7.5, 12.0, 30.0])
def test_corridor_direction_is_counter_clockwise_about_cell_to_base(direction_deg):
    cell = np.array([0.68, -0.18])
    way = corridor(tuple(cell), direction_deg, staging_x=0.43)
    out = np.array(way.staging_xy) - cell
    angle = math.atan2(out[1], out[0]) - math.atan2(-cell[1], -cell[0])
    assert math.degrees(math.remainder(angle, math.tau)) == pytest.approx(direction_deg)


@pytest.mark.parametrize(("cell", "direction_deg"), [((0.4, 0.0), 0.0), ((0.6, 0.0), 90.0), ((0.6, 0.3), 120.0)])
def test_corridor_that_misses_the_staging_line_is_refused(cell, direction_deg):
    with pytest.raises(ValueError, match="staging line"):
        corridor(cell, direction_deg, staging_x=0.43)


def test_hand_points_along_its_heading_and_below_the_horizontal():
    pose = hand_pose(np.array([0.5, 0.1, 0.1]), math.radians(30), math.radians(50))
    assert np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3))
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
    forward = pose[:3, 2]
    assert math.degrees(math.atan2(forward[1], forward[0])) == pytest.approx(30)
    assert math.degrees(math.asin(-forward[2])) == pytest.approx(50)
    assert pose[2, 1] == pytest.approx(0.0)  # the jaws close in the plane of the table


def test_inside_names_the_cell_that_holds_a_point():
    centres = np.array([[0.5, 0.0], [0.62, 0.0]])
    assert inside(centres, 0.12, np.array([0.6, 0.05])).tolist() == [False, True]
    assert not inside(centres, 0.12, np.array([0.6, 0.09])).any()


def test_commands_keep_the_joint_limits_and_reach_the_end():
    path = np.column_stack([np.linspace(0, 1.2, 30), np.linspace(0, -0.4, 30)])
    speed, acceleration, dt = np.array([1.0, 2.0]), np.array([3.0, 3.0]), 0.05
    commands = timed(path, 0.3, dt, 10.0, speed, acceleration)
    velocity = np.diff(commands, axis=0, prepend=path[:1]) / dt
    assert np.allclose(commands[-1], path[-1])
    assert (np.abs(velocity) <= speed + 1e-9).all()
    assert (np.abs(np.diff(velocity, axis=0)) / dt <= acceleration + 1e-9).all()


def test_objects_are_the_same_for_a_seed():
    draws = [preset("objects/mixed").draw(5, np.random.default_rng(seed)) for seed in (3, 3, 4)]
    assert draws[0] == draws[1] != draws[2]
    assert [body.shape for body in draws[0]] == ["cuboid", "cylinder"] * 2 + ["cuboid"]
    assert Body("cuboid", 0.025, 0.15).radius_m == pytest.approx(0.025 * math.sqrt(2))


@pytest.mark.parametrize(
    ("build", "field"),
    [
        (lambda: replace(preset("arm/panda_slim"), model="jaco"), "arm.model"),
        (lambda: replace(preset("arm/panda_slim"), n_sectors=1), "arm.n_sectors"),
        (lambda: preset("arm/panda_slim", corridor_margin_m=-0.1), "arm.corridor_margin_m"),
        (lambda: replace(preset("arm/panda_slim"), tilt_deg=math.nan), "arm.tilt_deg"),
        (lambda: replace(preset("arm/panda_slim"), lift_m=0.0), "arm.lift_m"),
        (lambda: replace(preset("objects/mixed"), shapes="sphere"), "objects.shapes"),
        (lambda: replace(preset("objects/mixed"), height_m=(0.2, 0.1)), "objects.height_m"),
        (lambda: replace(preset("objects/mixed"), can_radius_m=(0.02,)), "objects.can_radius_m"),  # type: ignore[arg-type]
        (lambda: replace(preset("view/corner"), width_px=1), "view.width_px"),
        (lambda: replace(preset("view/corner"), position_m=(0.42, 0.02, 0.12)), "view.position_m"),
        (lambda: replace(preset("view/corner"), position_m=(1.0, 2.0)), "view.position_m"),
    ],
)
def test_bad_values_are_named(build, field):
    with pytest.raises(InputError, match=field):
        build()


def test_a_point_on_a_pixel_s_sight_line_is_seen_at_that_pixel():
    camera = preset("camera/kinect")
    pose, lines = camera.pose(Layout.grid(3, 6, 0.12, 0.50)), sight_lines(camera.intrinsic, (480, 640))
    ahead = lines[40, 600] * 1.3 @ pose[:3, :3].T + pose[:3, 3]
    pixel, depth = pixels_of(np.stack([ahead, 2 * pose[:3, 3] - ahead]), camera.intrinsic, pose)
    assert np.allclose(pixel[0], [600.5, 40.5])
    assert np.allclose(depth, [1.3, -1.3])


def test_a_vector_is_turned_counter_clockwise():
    assert np.allclose(turned(np.array([2.0, 1.0]), math.pi / 2), [-1.0, 2.0])
