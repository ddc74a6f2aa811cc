"""The state is the environment's own: partial resets, what is returned, and what is saved."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict

from dore.errors import InputError
from dore.learn import keys
from dore.learn.env import RearrangeEnv
from dore.world.generator import Difficulty, FreshInstances
from tests.drawings import wide_hand
from tests.worlds import REWARDS, make_env, random_legal


def test_partial_reset_leaves_the_other_rows_alone():
    env = make_env(wide_hand(4, 6), 32, 6)
    generator = torch.Generator().manual_seed(0)
    observation = env.reset()
    observation = env.step(random_legal(env, observation, generator))["next"]
    ask = torch.zeros(32, 1, dtype=torch.bool)
    ask[::3] = True
    before, state = observation.clone(), env.state_dict()
    after = env.reset(observation.clone().set("_reset", ask))
    others = ~ask.squeeze(-1)
    for key in (keys.BOARD, keys.TARGET, keys.VISITED, keys.LEGAL_PICK, keys.PICKABLE, keys.FAILURE):
        assert torch.equal(after[key][others], before[key][others]), key
    assert not torch.equal(after[keys.BOARD][~others], before[keys.BOARD][~others])
    assert torch.equal(env.state_dict()["moves"][others], state["moves"][others])
    assert (env.state_dict()["moves"][~others] == 0).all()


def test_what_reset_and_step_return_may_be_written_into():
    """Nothing that a caller does to it changes the environment, and nothing that the environment does changes it."""

    def play(spoil: bool) -> TensorDict:
        env = make_env(wide_hand(4, 6), 32, 6)
        generator, taken = torch.Generator().manual_seed(0), []
        observation = env.reset()
        for _ in range(6):
            acted = random_legal(env, observation.clone(), generator)
            if spoil:
                _fill_all(observation)
            step = env.step(acted)["next"]
            taken.append(step.clone())
            ask = step[keys.DONE].clone()
            if spoil:
                _fill_all(step)
            if ask.any():
                env.reset(TensorDict({"_reset": ask}, batch_size=[32]))
            observation = env.observation()
        return torch.stack(taken)

    clean, spoiled = play(spoil=False), play(spoil=True)
    for key in clean.keys(include_nested=True, leaves_only=True):
        assert torch.equal(clean[key], spoiled[key]), key


def _fill_all(tensordict: TensorDict) -> None:
    for leaf in tensordict.values(include_nested=True, leaves_only=True):
        leaf.fill_(1)


def test_later_steps_leave_what_was_returned_as_it_was():
    env = make_env(wide_hand(4, 6), 32, 6)
    generator = torch.Generator().manual_seed(0)
    first = env.reset()
    kept = first.clone()
    observation = first.clone()
    for _ in range(3):
        _, observation = env.step_and_maybe_reset(random_legal(env, observation, generator))
    for key in kept.keys(include_nested=True, leaves_only=True):
        assert torch.equal(first[key], kept[key]), key


@pytest.mark.parametrize("name", [keys.BOARD, keys.TARGET, keys.VISITED])
def test_an_observation_that_is_not_the_environments_is_refused(name):
    env = make_env(wide_hand(3, 6), 8, 6)
    acted = random_legal(env, env.reset(), torch.Generator().manual_seed(0))
    other = acted.clone()
    other[name][3] ^= 1
    with pytest.raises(
        InputError, match=rf"^env\.step: {name}: got another one than the environment's, want"
    ) as refusal:
        env.step(other)
    assert "\n" not in str(refusal.value)
    env.step(acted)


@pytest.mark.parametrize(
    ("name", "change", "says"),
    [
        ("board", lambda board: board | (1 << 40), "board: number 1 has an obstacle off the board"),
        ("board", lambda board: board.int(), r"board: got torch.int32\[8, 1\], want torch.int64\[8, 1\] of this env"),
        ("target", lambda target: target + 99, r"target: got \d+ to \d+, want 0 to 17"),
        (
            "visited",
            lambda visited: visited[:, :-1],
            r"visited: got torch.int64\[8, 8, 1\], want torch.int64\[8, 9, 1\]",
        ),
        ("moves", lambda moves: moves - 1, "moves: got -1 to -1, want 0 to 9"),
        ("moves", lambda moves: None, "moves: got None, want torch.int64"),
    ],
)
def test_a_state_of_another_environment_is_refused(name, change, says):
    env = make_env(wide_hand(3, 6), 8, 6)
    env.reset()
    state, before = env.state_dict(), env.observation()
    with pytest.raises(InputError, match=rf"^env\.state_dict: {says}"):
        env.load_state_dict({**state, name: change(state[name])})
    assert torch.equal(env.observation()[keys.BOARD], before[keys.BOARD])


@pytest.mark.parametrize("other", [wide_hand(3, 5), wide_hand(4, 6), None])
def test_a_source_of_another_reach_is_refused(other):
    reach = wide_hand(3, 6)
    source = other and FreshInstances(other, Difficulty(2, 5), "train", 0)
    with pytest.raises(InputError, match=r"^env\.source: got .*, want a source of instances of the env's reach, 3 x 6"):
        RearrangeEnv(reach, source, 8, 6, REWARDS)


def test_a_loaded_state_dict_continues_as_the_original():
    env, other = make_env(wide_hand(3, 6), 32, 6), make_env(wide_hand(3, 6), 32, 6, seed=9)
    generator = torch.Generator().manual_seed(0)
    observation = env.reset()
    for _ in range(4):
        _, observation = env.step_and_maybe_reset(random_legal(env, observation, generator))
    other.load_state_dict(env.state_dict())
    again, seed = other.observation(), generator.get_state()
    for _ in range(4):
        _, observation = env.step_and_maybe_reset(random_legal(env, observation, generator))
    generator.set_state(seed)
    for _ in range(4):
        _, again = other.step_and_maybe_reset(random_legal(other, again, generator))
    assert torch.equal(observation[keys.BOARD], again[keys.BOARD])
    assert torch.equal(observation[keys.VISITED], again[keys.VISITED])
