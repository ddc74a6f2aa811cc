"""The camera over a running simulator, and what the task gained for it. Pictures need a Vulkan driver."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import sapien
import torch

from dore.errors import InputError
from dore.sim.camera_config import CameraConfig
from dore.sim.config import preset
from dore.sim.kinematics import ArmKinematics
from dore.sim.scene.agent import render_backend
from dore.sim.scene.task import CAMERA
from dore.sim.urdf import arm_files
from dore.sim.vision.camera import RgbdCamera, rendered
from dore.sim.vision.perception import detections
from dore.sim.vision.scene_estimate import NotUnderstood, Why, estimate
from dore.world.layout import Layout
from dore.world.problem import Scene
from tests.rendering import needs_vulkan

pytestmark = pytest.mark.sim

LAYOUT = Layout.grid(3, 6, 0.12, 0.50)
FULL: CameraConfig = preset("camera/kinect")


def make(backend: str, bodies: int, **options: Any) -> Any:
    return gym.make(
        "DoreTabletop-v1", layout=LAYOUT, bodies=preset("objects/mixed").draw(bodies, np.random.default_rng(4)),
        sim_backend="physx_cpu", render_backend=backend, **options,
    )  # fmt: skip


@pytest.fixture(scope="module")
def env() -> Iterator[Any]:
    """One for all tests: the shaders are compiled again, for ten seconds, when no renderer is left."""
    made = make(render_backend(), 18, obs_mode="none", reward_mode="none")
    yield made
    made.close()


def place(env: Any, cells: list[int], **options: Any) -> None:
    env.reset(seed=0, options={"cells": cells, **options})


@needs_vulkan
def test_every_cell_is_seen_past_the_ready_arm(env):
    cells = np.random.default_rng(1).permutation(18).tolist()
    place(env, cells)
    before = env.unwrapped.positions().clone()
    found = RgbdCamera(env, seed=0).look()
    assert (env.unwrapped.positions() == before).all()
    assert estimate(found, LAYOUT).scene == Scene(LAYOUT, tuple(sorted(cells[1:])), cells[0])


@needs_vulkan
def test_objects_off_the_middle_and_turned_are_where_they_were_put(env):
    cells, offsets, yaws = [1, 8, 16], [[0.01, 0.0], [-0.006, 0.007], [0.0, -0.01]], [0.5, 0.0, -0.6]
    place(env, cells, offsets_m=offsets, yaws_rad=yaws)
    at = LAYOUT.centres[cells].numpy() + offsets
    assert np.allclose(env.unwrapped.positions()[0, :3, :2], at, atol=1e-6)
    noisy = RgbdCamera(env, seed=0).look().objects
    exact = detections(rendered(env), LAYOUT, replace(FULL, target_by="segmentation"))
    for found, within_m, within_deg in ((noisy, 0.004, 4.0), (exact, 0.002, 2.0)):
        assert [one.is_target for one in found] == [True, False, False]
        assert [one.shape for one in found] == ["cuboid", "cylinder", "cuboid"]
        for one, xy, yaw in zip(found, at, yaws, strict=True):
            assert math.dist(one.xy, xy) < within_m
            assert abs(math.remainder(one.yaw_rad - yaw, math.pi / 2)) < math.radians(within_deg)


@needs_vulkan
def test_the_same_seed_takes_the_same_pictures(env):
    place(env, [3, 4])
    one, two, other = (RgbdCamera(env, seed=seed).frame() for seed in (7, 7, 8))
    assert (one.depth_m == two.depth_m).all()
    assert (one.depth_m != other.depth_m).any()
    assert (one.rgb == other.rgb).all()


@needs_vulkan
@pytest.mark.parametrize("y", [0.0, 0.11])
def test_an_object_just_before_the_grid_is_off_the_board(env, y):
    """Between the grid and the staging line, by the arm's hand or beside it."""
    x = 0.487
    place(env, [14, 3], offsets_m=[[0, 0], [x - LAYOUT.cells[3][0], y - LAYOUT.cells[3][1]]])
    found = RgbdCamera(env, seed=0).look()
    with pytest.raises(NotUnderstood) as caught:
        estimate(found, LAYOUT)
    assert caught.value.why is Why.OFF_BOARD


@needs_vulkan
def test_a_lying_object_is_reported_in_the_simulator(env):
    place(env, [14, 3, 6])
    quarter = math.sqrt(0.5)
    env.unwrapped.objects[2].set_pose(sapien.Pose(p=[0.68, 0.30, 0.025], q=[quarter, 0, quarter, 0]))
    found = RgbdCamera(env, seed=0).look()
    with pytest.raises(NotUnderstood, match=r"0\.1\d m long") as caught:
        estimate(found, LAYOUT)
    assert caught.value.why is Why.NOT_UPRIGHT


@needs_vulkan
def test_the_arm_before_the_grid_is_no_object_and_over_a_cell_may_hide_one(env):
    place(env, [14, 3, 5])
    task = env.unwrapped
    kinematics = ArmKinematics(arm_files(visuals=False, arm=task.arm), task.arm)
    upright = []
    for x, y, heading in ((0.43, 0.3, 0.0), (0.43, -0.3, 0.5), (0.56, -0.06, 0.0)):
        path, _ = kinematics.line(kinematics.ready(0.43), np.array([x, y, 0.10]), heading)
        task.agent.robot.set_qpos(torch.from_numpy(task.agent.open_handed(path[-1])[None]).float())
        upright.append([one.upright for one in RgbdCamera(env, seed=0).look().objects])
    assert upright == [[True] * 3, [True] * 3, [False, True, True]]


@needs_vulkan
def test_the_task_s_own_observations_come_from_the_same_camera(env):
    seeing = make(render_backend(), 3, obs_mode="rgb+depth+segmentation")
    observed, _ = seeing.reset(seed=0)
    images, params = observed["sensor_data"][CAMERA], observed["sensor_param"][CAMERA]
    shapes = {name: tuple(image.shape) for name, image in images.items()}
    assert shapes == {"rgb": (1, 480, 640, 3), "depth": (1, 480, 640, 1), "segmentation": (1, 480, 640, 1)}
    assert np.allclose(params["intrinsic_cv"][0], FULL.intrinsic, atol=1e-3)
    assert np.allclose(params["extrinsic_cv"][0], np.linalg.inv(FULL.pose(LAYOUT))[:3], atol=1e-5)
    seeing.close()


@needs_vulkan
def test_the_environment_s_camera_is_the_one_that_sees(env):
    """Its place, picture and noise are those of `camera=`, and of nothing else."""
    small = replace(FULL, width_px=320, height_px=240, field_of_view_deg=50.0, noise="none")
    seeing = make(render_backend(), 2, obs_mode="none", camera=small)
    place(seeing, [3, 4])
    frame, exact = RgbdCamera(seeing, seed=0).frame(), rendered(seeing)
    assert frame.depth_m.shape == (240, 320)
    assert (frame.intrinsic == small.intrinsic).all()
    assert (frame.depth_m == exact.depth_m).all()
    seeing.close()


def test_without_a_renderer_the_camera_says_so():
    blind = make("none", 2, obs_mode="none")
    place(blind, [3, 4])
    with pytest.raises(InputError, match="camera: no Vulkan driver here"):
        RgbdCamera(blind, seed=0).frame()
    blind.close()


def test_objects_beyond_the_cells_named_wait_beside_the_table(env):
    place(env, [3, 4])
    task = env.unwrapped
    for _ in range(20):
        env.step(None)
    assert task.waiting()[0].tolist() == [False] * 2 + [True] * 16
    assert np.allclose(task.positions()[0, :, 2] * 2, [body.height_m for body in task.bodies], atol=1e-3)
    assert task.evaluate()["all_in_cell"].all()
    assert task.evaluate()["all_upright"].all()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"offsets_m": [[0, 0]]}, "offsets_m: got"),
        ({"offsets_m": [[0, 0], [0, math.inf]]}, "offsets_m: got"),
        ({"offsets_m": "much"}, "want 2 numbers for each of 2 objects"),
        ({"yaws_rad": [0.1]}, "yaws_rad: got .* want a number for each of 2 objects"),
        ({"offsets_m": [[0, 0], [0, 0.10]]}, "offsets_m: objects 0 and 1 overlap"),
        ({"cells": []}, "cells: got"),
    ],
)
def test_reset_checks_its_options(env, options, says):
    with pytest.raises(InputError, match=says):
        place(env, **{"cells": [3, 4], **options})


def test_an_unknown_arm_is_refused():
    with pytest.raises(InputError, match=r"robot_uids: got 'robby', want one of .*panda_slim"):
        gym.make("DoreTabletop-v1", robot_uids="robby", render_backend="none")
