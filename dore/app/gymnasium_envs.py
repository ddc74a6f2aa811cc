"""The environment as Gymnasium has it: one (`gymnasium.make`), or many that step together (`gymnasium.make_vec`)."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium.spaces import Box, Discrete
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray
from tensordict import TensorDictBase
from torchrl.envs import TransformedEnv

from dore.app.front_door import make_env
from dore.errors import InputError, shown
from dore.learn.joint import Joint


class VectorRearrange(VectorEnv):
    """`num_envs` environments. An episode that ends starts again in the same step, as Gymnasium's SAME_STEP says.

    Observation Float32[N, C * G] and action Int64[N], pick * G + place, are those of `dore.learn.joint.Joint`; the
    reward Float64[N] is of the whole move. infos: `failure` Int64[N], a `dore.world.rules.Failure` code; `action_mask`
    Int8[N, G * G], what is legal next; `final_obs`, where an episode has ended.

    Args:
        num_envs: N.
        options: those of `dore.make_env`, as layout="6x6".

    Raises:
        InputError: names the option that is wrong.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012 as Gymnasium declares it

    def __init__(self, num_envs: int = 1, **options: Any) -> None:
        base = make_env(num_envs=num_envs, **options)
        self._env = TransformedEnv(base, Joint(base.reach))
        self.num_envs, self._n_actions = num_envs, base.reach.n_cells**2
        width = self._env.observation_spec["observation"].shape[-1]
        self.single_observation_space = Box(0.0, 1.0, (width,), np.float32)
        self.single_action_space = Discrete(self._n_actions)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._now: TensorDictBase = self._env.reset()

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """New episodes in all environments; a seed, or the first of a list, starts the instances over from it.

        Raises:
            InputError: options, of which there are none.
        """
        if options:
            raise InputError(f"options: got {shown(options)}, want none: what is played is given to gymnasium.make")
        first = seed[0] if isinstance(seed, list) else seed
        if first is not None:
            self._env.set_seed(first, static_seed=True)
        self._now = self._env.reset()
        return self._observation(self._now), self._info(self._now)

    def step(self, actions: NDArray[np.int64]) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """One move in each environment.

        Raises:
            InputError: other actions.
        """
        given = np.asarray(actions)
        integers = np.issubdtype(given.dtype, np.integer) and given.shape == (self.num_envs,)
        if not integers or given.min() < 0 or given.max() >= self._n_actions:
            wanted = f"want {self.num_envs} integers from 0 to {self._n_actions - 1}"
            raise InputError(f"action: got {shown(actions)}, {wanted}")
        self._now["action"] = torch.as_tensor(given.astype(np.int64))
        stepped, self._now = self._env.step_and_maybe_reset(self._now)
        after = stepped["next"]
        info = self._info(self._now) | {"failure": after["failure"].numpy()}
        done = after["done"].squeeze(-1).numpy()
        if done.any():
            info |= {"final_obs": self._observation(after), "_final_obs": done}
        flags = (after[name].squeeze(-1).numpy().copy() for name in ("terminated", "truncated"))
        reward = after["reward"].squeeze(-1).double().numpy()
        return self._observation(self._now), reward, *flags, info

    def action_masks(self) -> NDArray[np.bool_]:
        """Bool[N, G * G]: the legal actions now."""
        return np.asarray(self._now["action_mask"].numpy().copy())

    @staticmethod
    def _observation(now: TensorDictBase) -> NDArray[np.float32]:
        return np.asarray(now["observation"].numpy().copy())

    @staticmethod
    def _info(now: TensorDictBase) -> dict[str, Any]:
        return {"failure": now["failure"].numpy().copy(), "action_mask": now["action_mask"].numpy().astype(np.int8)}


class Rearrange(gym.Env[NDArray[np.float32], np.int64]):
    """One environment; see `VectorRearrange`, which is as fast for hundreds of them.

    Args:
        options: those of `dore.make_env`, as layout="6x6".
    """

    def __init__(self, **options: Any) -> None:
        self._one = VectorRearrange(1, **options)
        self.observation_space, self.action_space = self._one.single_observation_space, self._one.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """A new episode.

        Raises:
            InputError: options, of which there are none.
        """
        super().reset(seed=seed)
        observation, info = self._one.reset(seed=seed, options=options)
        return observation[0], _first(info)

    def step(self, action: np.int64) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """One move."""
        observation, reward, terminated, truncated, info = self._one.step(np.asarray([action]))
        observation = info.pop("final_obs", observation)
        info.pop("_final_obs", None)
        return observation[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), _first(info)

    def action_masks(self) -> NDArray[np.bool_]:
        """Bool[G * G]: the legal actions now, as sb3-contrib's maskable algorithms ask for them."""
        return np.asarray(self._one.action_masks()[0])


def _first(info: dict[str, Any]) -> dict[str, Any]:
    return {name: values[0] for name, values in info.items()}
