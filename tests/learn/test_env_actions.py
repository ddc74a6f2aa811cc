"""What the environment takes as an action: integers of any width, on the board, and nothing else."""

from __future__ import annotations

import pytest
import torch

from dore.errors import InputError
from dore.learn import keys
from dore.world.board import count
from dore.world.rules import Failure
from tests.drawings import wide_hand
from tests.worlds import make_env, random_legal


@pytest.mark.parametrize("kind", [torch.int64, torch.int32, torch.int16, torch.uint8])
def test_integers_of_any_width_are_the_same_moves(kind):
    """6 x 6 cells: a 32-bit shift loses the obstacles of the cells from 31 on."""
    env = make_env(wide_hand(6, 6), num_envs=256, most=9)
    observation = random_legal(env, env.reset(), torch.Generator().manual_seed(0))
    before = count(observation[keys.BOARD])
    for key in (keys.PICK, keys.PLACE):
        observation[key] = observation[key].to(kind)
    after = env.step(observation)["next"]
    assert (after[keys.FAILURE] == Failure.NONE).all()
    assert torch.equal(count(after[keys.BOARD]), before)


@pytest.mark.parametrize(
    ("key", "action", "says"),
    [
        (keys.PICK, torch.full((4,), 1.0), "env.step: pick.action: got torch.float32, want integers"),
        (keys.PLACE, torch.ones(4, dtype=torch.bool), "env.step: place.action: got torch.bool, want integers"),
        (keys.PLACE, torch.tensor([0, 1, 2, 18]), "env.step: place.action: got cells 0 to 18, want 0 to 17"),
        (keys.PICK, torch.tensor([-1, 1, 2, 3]), "env.step: pick.action: got cells -1 to 3, want 0 to 17"),
        (keys.PICK, None, r"env.step: pick.action: got none, want \[4\] cells"),
    ],
)
def test_other_actions_are_refused(key, action, says):
    env = make_env(wide_hand(3, 6), num_envs=4, most=6)
    observation = random_legal(env, env.reset(), torch.Generator().manual_seed(0))
    if action is None:
        del observation[key]
    else:
        observation[key] = action
    with pytest.raises(InputError, match=says):
        env._step(observation)
