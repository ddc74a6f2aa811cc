"""The RGB-D camera of a running environment. What it is like, only the environment's `camera` says."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar, Protocol

import numpy as np

from dore.errors import InputError
from dore.sim.scene.agent import NO_DRIVER
from dore.sim.scene.task import CAMERA, DoreTabletopEnv
from dore.sim.vision.coverage import observation
from dore.sim.vision.depth_noise import kinect_depth
from dore.sim.vision.perception import TARGET_SEGMENT, Frame
from dore.sim.vision.scene_estimate import Observation


class Sensor(Protocol):
    """What a closed loop sees with; made from an environment and a seed."""

    needs_renderer: ClassVar[bool]

    def __init__(self, env: Any, seed: int) -> None: ...

    def look(self) -> Observation:
        """The objects that are seen now, and the cells that are not measured.

        Raises:
            NotUnderstood: no table is seen.
        """


class RgbdCamera:
    """Takes noisy pictures of a `DoreTabletop-v1`, and detects the objects in them.

    It renders when asked, whatever the environment's observation mode, and changes nothing in it.

    Args:
        env: as gymnasium returns it; the first scene is seen where it holds several.
        seed: of the noise; the same seed and scenes give the same pictures.
    """

    needs_renderer: ClassVar[bool] = True

    def __init__(self, env: Any, seed: int) -> None:
        self._task: DoreTabletopEnv = env.unwrapped
        self._rng = np.random.default_rng(seed)
        self._pose_error = self._task.camera.pose_error(np.random.default_rng(seed))

    def look(self) -> Observation:
        """What one frame shows.

        Raises:
            InputError: as `rendered`.
            NotUnderstood: no table is seen.
        """
        return observation(self.frame(), self._task.layout, self._task.camera)

    def frame(self) -> Frame:
        """One picture, with the camera's noise.

        Raises:
            InputError: as `rendered`.
        """
        frame = rendered(self._task)
        frame = replace(frame, camera_to_world=frame.camera_to_world @ self._pose_error)
        if self._task.camera.noise == "none":
            return frame
        return replace(frame, depth_m=kinect_depth(frame.depth_m, frame.intrinsic, self._rng))


def rendered(env: Any) -> Frame:
    """One picture without noise; depth comes in whole millimetres.

    Raises:
        InputError: nothing can render here, or the camera does not see every cell.
    """
    task: DoreTabletopEnv = env.unwrapped
    if not task.scene.can_render():
        raise InputError(f"camera: {NO_DRIVER}")
    config = task.camera
    config.check_sees(task.layout)
    sensor = task.scene.sensors[CAMERA]
    task.scene.update_render(update_sensors=True, update_human_render_cameras=False)
    sensor.capture()
    images = {name: image[0].cpu().numpy() for name, image in sensor.get_obs(position=False).items()}
    return Frame(
        images["depth"][..., 0].astype(np.float64) / 1000, images["rgb"], config.intrinsic, config.pose(task.layout),
        _object_segments(task, images["segmentation"][..., 0]),
    )  # fmt: skip


def _object_segments(task: DoreTabletopEnv, ids: np.ndarray) -> np.ndarray:
    """Int64[H, W]: the simulator's ids as `Frame.segmentation` has them; arm and table are 0."""
    segments = np.zeros(ids.shape, dtype=np.int64)
    for index, actor in enumerate(task.objects):
        segments[ids == int(actor.per_scene_id[0])] = TARGET_SEGMENT + index
    return segments
