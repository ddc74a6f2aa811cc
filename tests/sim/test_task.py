"""The ManiSkill task as gymnasium makes it."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import sapien
import torch

import dore.sim.scene.task  # noqa: F401  (registers the environment)
from dore.errors import InputError
from dore.world.layout import Layout
from tests.setups import LAYOUT, OBJECTS, setup

pytestmark = pytest.mark.sim


def test_the_task_is_made_by_gymnasium_and_observes_its_state():
    env = gym.make("DoreTabletop-v1", obs_mode="state_dict", sim_backend="physx_cpu", render_backend="none")
    observed, _ = env.reset(seed=3)
    assert observed["extra"]["object_poses"].shape == (1, 7 * 7)
    again, _ = env.reset(seed=3)
    assert (observed["extra"]["object_poses"] == again["extra"]["object_poses"]).all()
    _, reward, terminated, _, info = env.step(env.action_space.sample() * 0)
    assert not info["success"].any()
    assert not terminated.any()
    assert float(reward) == 0.0
    with pytest.raises(InputError, match="different cells"):
        env.reset(options={"cells": [0] * 7})
    env.close()


def test_irregular_layouts_and_too_many_objects():
    layout = Layout(((0.55, 0.1), (0.66, -0.05)), 0.12)
    bodies = OBJECTS.draw(3, np.random.default_rng(0))
    settings: dict[str, Any] = {"layout": layout, "obs_mode": "none", "render_backend": "none"}
    env = gym.make("DoreTabletop-v1", bodies=bodies[:2], **settings)
    env.reset(options={"cells": [1, 0]})
    assert np.allclose(env.unwrapped.positions()[0, :, :2], [[0.66, -0.05], [0.55, 0.1]], atol=1e-3)
    env.close()
    with pytest.raises(InputError, match="3 objects"):
        gym.make("DoreTabletop-v1", bodies=bodies, **settings)


@pytest.mark.parametrize(
    ("body", "xyz", "lying", "unmet"),
    [
        (0, (0.30, 0.0, 0.30), False, None),
        (0, (0.30, 0.0, 0.08), False, "target_lifted"),
        (0, (0.56, 0.06, 0.30), False, "target_out"),
        (1, (0.56, 0.18, 0.03), True, "all_upright"),
        (1, (0.68, 0.50, 0.076), False, "all_in_cell"),
        (1, (0.56, -0.06, 0.076), False, "all_in_cell"),  # where the other obstacle stands
    ],
)
def test_success_needs_every_condition(body, xyz, lying, unmet):
    env = setup().environment(LAYOUT, OBJECTS.draw(3, np.random.default_rng(0)), "none")
    env.reset(options={"cells": [14, 1, 3]})
    task = env.unwrapped
    task.objects[0].set_pose(sapien.Pose(p=[0.30, 0.0, 0.30]))
    task.objects[body].set_pose(sapien.Pose(p=xyz, q=[0.5**0.5, 0.5**0.5, 0, 0] if lying else [1, 0, 0, 0]))
    conditions = {name: bool(value[0]) for name, value in task.evaluate().items()}
    assert conditions.pop("success") == (unmet is None)
    assert [name for name, met in conditions.items() if not met] == ([unmet] if unmet else [])
    env.close()


@pytest.mark.parametrize(
    ("one", "other", "grasped"),
    [
        ((0.0, 5.0, 0.0), (0.0, -5.0, 0.0), True),
        ((0.0, 5.0, 0.0), (0.0, 5.0, 0.0), False),  # pushed from one side
        ((0.0, 5.0, 0.0), (0.0, -0.1, 0.0), False),  # hardly touched from the other
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), False),
    ],
)
def test_a_grasp_presses_from_both_sides_against_each_other(monkeypatch, one, other, grasped):
    env = setup().environment(LAYOUT, OBJECTS.draw(1, np.random.default_rng(0)), "none")
    env.reset(options={"cells": [14]})
    agent, forces = env.unwrapped.agent, iter([one, other])
    monkeypatch.setattr(agent, "_press", lambda links, item: torch.tensor([next(forces)]))
    assert bool(agent.is_grasping(env.unwrapped.objects[0])[0]) == grasped
    env.close()
