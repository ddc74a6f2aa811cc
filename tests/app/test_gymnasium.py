"""The environment as Gymnasium has it: checked by Gymnasium, and the same as the TorchRL one."""

from __future__ import annotations

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
from gymnasium.utils.env_checker import check_env  # noqa: E402

from dore.errors import InputError  # noqa: E402

ENV = "dore:Dore/Rearrange-v0"


def many(n: int, **options):
    return gymnasium.make_vec(ENV, n, vectorization_mode="vector_entry_point", **options)


@pytest.mark.filterwarnings("error::UserWarning")
def test_gymnasiums_checker_passes():
    check_env(gymnasium.make(ENV, layout="5x5").unwrapped, skip_render_check=True)


@pytest.mark.parametrize("make", [lambda: gymnasium.make(ENV), lambda: many(2)])
def test_a_reset_ignores_no_options(make):
    env = make()
    env.reset(options={})
    with pytest.raises(InputError, match=r"options: got {'cells': \[1\]}, want none"):
        env.reset(options={"cells": [1]})


def test_a_seed_gives_the_same_episodes_and_masked_moves_never_fail():
    envs, other = many(64, layout="6x6"), many(64, layout="6x6", seed=5)
    first, again = envs.reset(seed=3)[0], other.reset(seed=3)[0]
    assert np.array_equal(first, again)
    rng, ends = np.random.default_rng(0), 0
    for _ in range(20):
        action = np.array([rng.choice(np.flatnonzero(mask)) for mask in envs.unwrapped.action_masks()])
        observation, reward, terminated, truncated, info = envs.step(action)
        assert np.array_equal(observation, other.step(action)[0])
        assert np.isin(info["failure"], [0, 5]).all(), "no move but the last one of a dead end fails"
        assert (reward[~terminated] == 0).all()
        assert (reward[terminated] != 0).all()
        ended = terminated | truncated
        ends += ended.sum()
        if ended.any():
            assert not np.array_equal(info["final_obs"][ended], observation[ended])
    assert ends > 64


def test_one_environment_ends_where_its_episode_ends():
    env = gymnasium.make(ENV, layout="3x6", max_moves=2)
    env.reset(seed=0)
    ends = []
    while not any(ends):
        action = int(np.flatnonzero(env.unwrapped.action_masks())[0])
        observation, _, *ends, _ = env.step(action)
    assert observation in env.observation_space
    with pytest.raises(gymnasium.error.ResetNeeded):
        gymnasium.make(ENV).step(0)


@pytest.mark.parametrize("action", [1.7, True, 324, -1, np.nan, "x", None])
def test_what_is_no_action_is_refused(action):
    env = gymnasium.make(ENV, layout="3x6").unwrapped
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"^action: got \S.*, want 1 integers from 0 to 323$"):
        env.step(action)


def test_a_wrong_option_is_one_line():
    with pytest.raises(ValueError, match="Could not find 'layout/3x7'"):
        gymnasium.make(ENV, layout="3x7")
