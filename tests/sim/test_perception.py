"""The camera's reading of the board, on cast rays: no simulator and no renderer needed."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dore.errors import InputError
from dore.sim.camera_config import CameraConfig
from dore.sim.config import preset
from dore.sim.vision.depth_noise import INVERSE_DEPTH_STEP, kinect_depth
from dore.sim.vision.perception import detections
from dore.sim.vision.scene_estimate import NotUnderstood, Observation, Why, estimate
from dore.world.layout import Layout
from dore.world.problem import Scene
from tests.raycast import GREEN, Solid, lying, picture, standing

LAYOUT = Layout.grid(3, 6, 0.12, 0.50)
FULL: CameraConfig = preset("camera/kinect")
SMALL = replace(FULL, width_px=320, height_px=240, patch_m=0.01, fewest_patches=4)
"""A quarter of the pixels, so patches twice as wide."""
TARGET = standing("cuboid", LAYOUT.cells[14], colour=GREEN)


def seen(*solids: Solid, config: CameraConfig = SMALL, **more: Any):
    return detections(picture(config, LAYOUT, solids, **more), LAYOUT, config)


def why(*solids: Solid) -> tuple[Why, str]:
    with pytest.raises(NotUnderstood) as caught:
        estimate(Observation(seen(*solids)), LAYOUT)
    assert "\n" not in str(caught.value)
    return caught.value.why, str(caught.value)


@pytest.mark.parametrize("shape", ["cuboid", "cylinder"])
@pytest.mark.parametrize(("cell", "yaw"), [(0, 0.0), (5, 0.3), (8, -0.7), (12, 0.75), (17, 0.1)])
def test_place_size_and_turn_of_one_object(shape, cell, yaw):
    x, y = LAYOUT.cells[cell]
    (one,) = seen(standing(shape, (x + 0.008, y - 0.006), 0.023, 0.142, yaw), config=FULL)
    assert math.dist(one.xy, (x + 0.008, y - 0.006)) < 0.0015
    assert one.half_width_m == pytest.approx(0.023, abs=0.001)
    assert one.height_m == pytest.approx(0.142, abs=0.001)
    assert one.shape == shape
    assert one.upright
    assert not one.is_target
    assert abs(math.remainder(one.yaw_rad - (yaw if shape == "cuboid" else 0.0), math.pi / 2)) < math.radians(1.5)


def test_an_empty_table_holds_nothing_and_a_crumb_is_no_object():
    assert seen() == ()
    assert seen(standing("cuboid", (0.6, 0.1), 0.005, 0.03)) == ()


@pytest.mark.parametrize("seed", range(3))
def test_a_noisy_crowded_board_is_read(seed):
    rng = np.random.default_rng(seed)
    cells = rng.permutation(18)[:11].tolist()
    solids = [
        standing(
            ("cuboid", "cylinder")[i % 2], tuple(LAYOUT.centres[cell].numpy() + rng.uniform(-0.007, 0.007, 2)),
            yaw=rng.uniform(0, 1.5), colour=GREEN if i == 0 else (194, 124, 104),
        )
        for i, cell in enumerate(cells)
    ]  # fmt: skip
    frame = picture(FULL, LAYOUT, solids)
    noisy = replace(frame, depth_m=kinect_depth(frame.depth_m, frame.intrinsic, rng))
    found = detections(noisy, LAYOUT, FULL)
    assert estimate(Observation(found), LAYOUT).scene == Scene(LAYOUT, tuple(sorted(cells[1:])), cells[0])
    middles = np.array([solid.middle[:2] for solid in solids])
    assert max(np.linalg.norm(middles - one.xy, axis=1).min() for one in found) < 0.004
    assert {one.shape for one in found} == {"cuboid", "cylinder"}


def test_a_camera_that_hangs_a_little_askew_is_forgiven():
    """Off by half a degree and 4 mm from where it is said to be: heights are above the table that is seen."""
    pose, turn = FULL.pose(LAYOUT), math.radians(0.5)
    askew = np.array([[1, 0, 0], [0, math.cos(turn), -math.sin(turn)], [0, math.sin(turn), math.cos(turn)]])
    pose[:3, :3] = pose[:3, :3] @ askew
    pose[2, 3] += 0.004
    (one,) = seen(standing("cuboid", LAYOUT.cells[9]), config=FULL, pose=pose)
    assert one.height_m == pytest.approx(0.145, abs=0.002)
    assert math.dist(one.xy, LAYOUT.cells[9]) < 0.015


def test_the_scene_has_ids_in_order():
    board = [standing("cylinder", LAYOUT.cells[cell]) for cell in (9, 2, 16)]
    assert estimate(Observation(seen(*board, TARGET)), LAYOUT).scene == Scene(LAYOUT, (2, 9, 16), 14)


@pytest.mark.parametrize("shape", ["cuboid", "cylinder"])
@pytest.mark.parametrize("yaw", [0.0, 0.6, math.pi / 2])
def test_what_lies_is_reported(shape, yaw):
    kind, message = why(TARGET, lying(shape, LAYOUT.cells[2], yaw=yaw))
    assert kind is Why.NOT_UPRIGHT
    assert "object at (0.5" in message
    assert "0.05 m high" in message


def test_two_that_touch_are_reported():
    x, y = LAYOUT.cells[7]
    kind, _ = why(TARGET, standing("cuboid", (x, y)), standing("cylinder", (x, y - 0.051)))
    assert kind is Why.NOT_UPRIGHT


def test_two_in_a_cell_are_reported():
    x, y = LAYOUT.cells[7]
    two = standing("cylinder", (x - 0.035, y - 0.035), 0.02), standing("cylinder", (x + 0.035, y + 0.035), 0.02)
    kind, message = why(TARGET, *two)
    assert kind is Why.SHARED_CELL
    assert "two objects in cell 8: the object at (0.64" in message


def test_what_stands_before_the_grid_half_hidden_is_reported():
    """The object on cell 4 hides the lower half of the one before it."""
    kind, message = why(TARGET, standing("cuboid", LAYOUT.cells[3]), standing("cuboid", (0.486, -0.06)))
    assert kind is Why.OFF_BOARD
    assert "at (0.48" in message


@pytest.mark.parametrize("xy", [(0.488, 0.06), (0.488, -0.31), (0.68, 0.42), (0.92, 0.0)])
def test_what_stands_off_the_board_is_reported(xy):
    """Before the grid, beside it and beyond it."""
    kind, message = why(TARGET, standing("cuboid", xy))
    assert kind is Why.OFF_BOARD
    assert message.startswith(f"the camera: the object at ({xy[0]:.1f}"[:-1])
    assert message.endswith("is outside every cell")


def test_no_target_and_two_targets_are_reported():
    assert why(standing("cuboid", LAYOUT.cells[3])) == (Why.NO_TARGET, "the camera: no target seen, but 1 obstacles")
    other = standing("cylinder", LAYOUT.cells[3], colour=GREEN)
    assert why(TARGET, other) == (Why.TWO_TARGETS, "the camera: 2 targets seen, in cells 4 and 15; want one")


def test_a_hand_before_the_grid_is_left_out_and_over_a_cell_reported():
    hand, fingertips = (
        standing("cuboid", (x, 0.0), 0.02, height, bottom=0.10) for x, height in ((0.47, 0.5), (0.43, 0.1))
    )
    assert len(seen(TARGET, hand)) == 1
    assert len(seen(TARGET, fingertips)) == 1
    kind, _ = why(TARGET, standing("cuboid", (0.56, 0.06), 0.02, 0.5, bottom=0.10))
    assert kind is Why.NOT_UPRIGHT


def test_no_table_is_reported():
    frame = picture(SMALL, LAYOUT, [])
    with pytest.raises(NotUnderstood, match="no table") as caught:
        detections(replace(frame, depth_m=np.zeros_like(frame.depth_m)), LAYOUT, SMALL)
    assert caught.value.why is Why.NO_TABLE


def test_the_target_by_segment_whatever_its_colour():
    config = replace(SMALL, target_by="segmentation")
    frame = picture(config, LAYOUT, [standing("cuboid", LAYOUT.cells[3]), TARGET])
    first, second = detections(frame, LAYOUT, config)
    assert (first.is_target, second.is_target) == (True, False)
    with pytest.raises(ValueError, match="has none"):
        detections(replace(frame, segmentation=None), LAYOUT, config)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"noise": "snow"}, "camera.noise: got 'snow', want one of kinect, none"),
        ({"target_by": "name"}, "camera.target_by"),
        ({"position_m": (0.0, math.nan, 1.0)}, "camera.position_m"),
        ({"position_m": (-0.02, 0.0, 1.0)}, "which way is up"),
        ({"look_at_m": (0.0, 1.0)}, "camera.look_at_m: got"),
        ({"target_hue_deg": (170.0, 105.0)}, "camera.target_hue_deg"),
        ({"field_of_view_deg": 180.0}, "camera.field_of_view_deg"),
        ({"width_px": 2}, "camera.width_px"),
        ({"patch_m": 0.0}, "camera.patch_m"),
        ({"tallest_m": 0.01}, "camera.tallest_m: got 0.01, want more than"),
    ],
)
def test_a_bad_camera_is_refused(change, says):
    with pytest.raises(InputError, match=says):
        replace(FULL, **change)


def test_a_layout_out_of_the_picture_is_refused():
    FULL.check_sees(LAYOUT)
    with pytest.raises(InputError, match="cell 1 is not all in the picture"):
        FULL.check_sees(Layout.grid(3, 12, 0.12, 0.50))


def test_no_line_of_sight_to_a_cell_passes_the_arm():
    """The arm stays behind the staging line, the camera hangs on the other side of every cell's near edge."""
    assert FULL.pose(LAYOUT)[0, 3] > LAYOUT.centres[:, 0].max() + LAYOUT.cell_m / 2


def test_kinect_noise_is_as_published_on_a_wall():
    """Facing the camera at one metre: 0.0012 + 0.0019 * 0.6^2 m, and the even spread of a step."""
    wall = np.full((240, 320), 1.0)
    one, two = (kinect_depth(wall, SMALL.intrinsic, np.random.default_rng(seed)) for seed in (1, 1))
    assert (one == two).all()
    step = INVERSE_DEPTH_STEP
    assert one.std() == pytest.approx(math.hypot(0.0012 + 0.0019 * 0.36, step / math.sqrt(12)), rel=0.03)
    assert one.mean() == pytest.approx(1.0, abs=1e-4)
    assert np.allclose(1 / one / step, np.rint(1 / one / step))


def test_a_kinect_loses_what_is_out_of_range_grazed_or_in_shadow():
    rng = np.random.default_rng(0)
    far = kinect_depth(np.full((20, 20), 3.5), SMALL.intrinsic, rng)
    assert not far.any()
    assert not kinect_depth(np.zeros((20, 20)), SMALL.intrinsic, rng).any()
    steep = 1 / (0.5 + 0.02 * np.arange(30)[:, None] + np.zeros((1, 50)))
    assert not kinect_depth(steep, FULL.intrinsic, rng)[5:-5].any()
    step = np.full((50, 200), 1.2)
    step[:, 80:120] = 0.8
    lost = (kinect_depth(step, FULL.intrinsic, rng) == 0).mean(0)
    width = FULL.intrinsic[0, 0] * 0.075 * (1 / 0.8 - 1 / 1.2)
    assert lost[:80].sum() == pytest.approx(width, abs=2.5)
    assert lost[125:].sum() < 1
