"""What a frame does not show: cells that were not measured, and objects that are not one whole one. On cast rays."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from dore.errors import InputError
from dore.sim.camera_config import CameraConfig
from dore.sim.config import preset
from dore.sim.vision.coverage import observation
from dore.sim.vision.depth_noise import kinect_depth
from dore.sim.vision.perception import Frame
from dore.sim.vision.scene_estimate import NotUnderstood, Why, cell_of, estimate
from dore.world.layout import Layout
from tests.raycast import GREEN, Solid, picture, standing

LAYOUT = Layout.grid(3, 6, 0.12, 0.50)
CAMERA: CameraConfig = preset("camera/kinect")
TARGET = standing("cuboid", LAYOUT.cells[14], colour=GREEN)
X, Y = LAYOUT.cells[8]


def noisy(*solids: Solid, seed: int = 0) -> Frame:
    frame = picture(CAMERA, LAYOUT, solids)
    return replace(frame, depth_m=kinect_depth(frame.depth_m, frame.intrinsic, np.random.default_rng(seed)))


def why(frame: Frame, config: CameraConfig = CAMERA) -> tuple[Why, str]:
    with pytest.raises(NotUnderstood) as caught:
        estimate(observation(frame, LAYOUT, config), LAYOUT)
    return caught.value.why, caught.value.reason


def leaning(degrees: float, shape: str = "cuboid") -> Solid:
    """An object that has tipped over an edge, away from the robot."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    rotation = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    return Solid(shape, (0.025, 0.025, 0.0725), (X, Y, 0.0725 * c + 0.025 * s), rotation)


@pytest.mark.parametrize("seed", range(3))
def test_an_ordinary_scene_is_all_measured(seed):
    rng = np.random.default_rng(seed)
    cells = rng.permutation(18)[:10].tolist()
    solids = [
        standing(("cuboid", "cylinder")[i % 2], LAYOUT.cells[cell], yaw=rng.uniform(0, 1.5))
        for i, cell in enumerate(cells)
    ]
    solids[0] = replace(solids[0], colour=GREEN)
    seen = observation(noisy(*solids, seed=seed), LAYOUT, CAMERA)
    assert seen.unmeasured == frozenset()
    assert [one.doubt for one in seen.objects] == [""] * 10


def test_an_obstacle_without_depth_leaves_its_cell_unmeasured():
    """Glass, or a black or shiny surface."""
    frame = noisy(TARGET, *(standing("cylinder", LAYOUT.cells[cell]) for cell in (2, 8)))
    frame.depth_m[frame.segmentation == 3] = 0
    assert why(frame) == (Why.NOT_MEASURED, "cell 9 is not measured: something may stand there unseen")


def test_what_stands_hidden_behind_a_tall_object_is_not_taken_for_an_empty_cell():
    x, y = LAYOUT.cells[15]
    tall, low = standing("cuboid", (x, y), 0.035, 0.21), standing("cuboid", (x - 0.075, y), 0.02, 0.06)
    for solids in ([TARGET, tall, low], [TARGET, tall]):
        kind, reason = why(noisy(*solids))
        assert kind is Why.NOT_MEASURED
        assert reason.startswith("cell 10 is not measured")


def test_a_cell_half_behind_a_tall_object_is_measured_and_a_small_object_there_is_not_missed():
    x, y = LAYOUT.cells[1]
    tall = standing("cuboid", (x + 0.114, y + 0.004), 0.025, 0.15, yaw=0.4)
    for seed in range(3):
        assert estimate(observation(noisy(TARGET, tall, seed=seed), LAYOUT, CAMERA), LAYOUT).scene.obstacles == (7,)
        behind = standing("cylinder", (x + 0.05, y + 0.02), 0.02, 0.06)
        seen = observation(noisy(TARGET, tall, behind, seed=seed), LAYOUT, CAMERA)
        assert 1 in seen.unmeasured | {cell_of(one, LAYOUT) for one in seen.objects}


def test_two_touching_slim_objects_are_not_one():
    two = (standing("cuboid", (X, Y + side * 0.02), 0.02, 0.145) for side in (1, -1))
    kind, reason = why(noisy(TARGET, *two))
    assert kind is Why.NOT_WHOLE
    assert "in cell 9 is not one whole object: its top is 2.0 times as long as wide" in reason


def test_the_target_on_a_box_is_not_the_target_alone():
    box = standing("cuboid", (X, Y), 0.025, 0.07)
    on_it = standing("cuboid", (X, Y), 0.025, 0.07, bottom=0.07, colour=GREEN)
    kind, reason = why(noisy(on_it, box))
    assert kind is Why.NOT_WHOLE
    assert "stacked or touching" in reason


@pytest.mark.parametrize("shape", ["cuboid", "cylinder"])
def test_what_leans_is_told_from_what_stands(shape):
    for degrees in (0, 2):
        assert estimate(
            observation(noisy(TARGET, leaning(degrees, shape)), LAYOUT, CAMERA), LAYOUT
        ).scene.obstacles == (8,)
    for degrees in (9, 13):
        kind, reason = why(noisy(TARGET, leaning(degrees, shape)))
        assert kind is Why.NOT_WHOLE
        assert "leans by" in reason


def test_what_the_border_of_the_picture_cuts_is_not_whole():
    frame = noisy(TARGET, standing("cuboid", LAYOUT.cells[8]))
    columns = np.nonzero(frame.segmentation == 2)[1]
    left = int(columns.mean())
    cut = {name: getattr(frame, name)[:, left:] for name in ("depth_m", "rgb", "segmentation")}
    intrinsic = frame.intrinsic - [[0, 0, left], [0, 0, 0], [0, 0, 0]]
    seen = observation(replace(frame, **cut, intrinsic=intrinsic), LAYOUT, CAMERA)
    doubts = {one.doubt for one in seen.objects if abs(one.xy[0] - X) < 0.05}
    assert doubts == {"the picture's border cuts it"}
    assert seen.unmeasured


@pytest.mark.parametrize(("metres", "degrees", "fine"), [(0.002, 0.2, True), (0.08, 0.0, False), (0.0, 9.0, False)])
def test_a_small_error_of_the_pose_is_forgiven_and_a_large_one_is_noticed(metres, degrees, fine):
    frame = noisy(TARGET, *(standing("cylinder", LAYOUT.cells[cell]) for cell in (2, 8, 11)))
    config = replace(CAMERA, pose_error_m=metres, pose_error_deg=degrees)
    wrong = 0
    for seed in range(6):
        error = config.pose_error(np.random.default_rng(seed))
        taken_for = replace(frame, camera_to_world=frame.camera_to_world @ error)
        try:
            wrong += estimate(observation(taken_for, LAYOUT, CAMERA), LAYOUT).scene.obstacles != (2, 8, 11)
        except NotUnderstood:
            wrong += 1
    assert (wrong == 0) == fine


def test_the_error_of_the_pose_is_drawn_from_the_seed():
    config = replace(CAMERA, pose_error_m=0.01, pose_error_deg=1.0)
    one, same, other = (config.pose_error(np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert (one == same).all()
    assert (one != other).any()
    assert (CAMERA.pose_error(np.random.default_rng(1)) == np.eye(4)).all()
    with pytest.raises(InputError, match=r"camera.pose_error_deg: got 90"):
        replace(CAMERA, pose_error_deg=90.0)
