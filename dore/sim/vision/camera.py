"""The RGB-D camera over a running environment."""

from __future__ import annotations

from typing import Any

import numpy as np

from dore.errors import InputError
from dore.sim.scene.task import EYE, DoreTabletopEnv
from dore.sim.vision.camera_config import EyeConfig
from dore.sim.vision.depth_noise import kinect_depth
from dore.sim.vision.perception import TARGET_SEGMENT, Frame, sightings
from dore.sim.vision.scene_estimate import Sighting


class Eye:
    """Takes noisy pictures of a `DoreTabletop-v1`, and says which objects are in them.

    It draws when asked, whatever the environment's observation mode, and changes nothing in it.

    Args:
        config: its camera must be the environment's (`eye=`); noise and reading may be others.
        seed: of the noise; the same seed and scenes give the same pictures.
    """

    def __init__(self, config: EyeConfig, seed: int) -> None:
        self.config = config
        self._rng = np.random.default_rng(seed)

    def look(self, env: Any) -> tuple[Sighting, ...]:
        """The objects in one frame.

        Raises:
            InputError: as `frame`.
            NotUnderstood: no table is seen.
        """
        return sightings(self.frame(env), env.unwrapped.layout, self.config)

    def frame(self, env: Any) -> Frame:
        """One picture of an environment, as gymnasium returns it; of the first scene where it holds several.

        Raises:
            InputError: nothing can render there, its camera is another, or does not see every cell.
        """
        task: DoreTabletopEnv = env.unwrapped
        if not task.scene.can_render():
            raise InputError(
                "eye: nothing renders here; for a driver run scripts/install_lavapipe.sh (Debian 12, as root)"
            )
        if task.eye.camera != self.config.camera:
            raise InputError("eye: the environment was made with another camera, want the same eye= for both")
        self.config.check_sees(task.layout)
        camera = task.scene.sensors[EYE]
        task.scene.update_render(update_sensors=True, update_human_render_cameras=False)
        camera.capture()
        seen = {name: image[0].cpu().numpy() for name, image in camera.get_obs(position=False).items()}
        depth = seen["depth"][..., 0].astype(np.float64) / 1000
        if self.config.noise == "kinect":
            depth = kinect_depth(depth, self.config.intrinsic, self._rng)
        return Frame(
            depth, seen["rgb"], self.config.intrinsic, self.config.pose(task.layout),
            _object_segments(task, seen["segmentation"][..., 0]),
        )  # fmt: skip


def _object_segments(task: DoreTabletopEnv, ids: np.ndarray) -> np.ndarray:
    """Int64[H, W]: the simulator's ids as `Frame.segmentation` has them; arm and table are 0."""
    segments = np.zeros(ids.shape, dtype=np.int64)
    for index, actor in enumerate(task.objects):
        segments[ids == int(actor.per_scene_id[0])] = TARGET_SEGMENT + index
    return segments
