"""The TorchRL environment: specs, rewards, resets that leave other rows alone, and the mask traps."""

from __future__ import annotations

import pytest
import torch
from torchrl.envs import ActionMask, TransformedEnv, check_env_specs

from dore.errors import InputError
from dore.learn import keys
from dore.learn.env import RearrangeEnv, Rewards
from dore.world.board import pack
from dore.world.instances import FixedInstances, InstanceSet
from dore.world.layout import Layout
from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.rules import Failure, legal_places
from tests.drawings import wide_hand
from tests.worlds import REWARDS, make_env


def random_legal(env: RearrangeEnv, shown, generator: torch.Generator):
    """The same TensorDict with a random legal move in every row."""
    pick = shown[keys.PICK_MASK].float().multinomial(1, generator=generator).squeeze(-1)
    places = legal_places(env.reach, shown[keys.BOARD], shown[keys.TARGET], shown[keys.VISITED], pick)
    place = places.float().multinomial(1, generator=generator).squeeze(-1)
    return shown.set(keys.PICK, pick).set(keys.PLACE, place)


@pytest.mark.parametrize("size", [(3, 6, 0.12), (10, 10, 0.09)])
def test_specs(size):
    check_env_specs(make_env(wide_hand(*size), num_envs=7, most=9))


def test_specs_with_action_masks():
    env = TransformedEnv(make_env(wide_hand(3, 6), 16, 9), ActionMask(keys.PICK, keys.PICK_MASK))
    env.append_transform(ActionMask(keys.PLACE, keys.PLACE_MASK))
    check_env_specs(env)


def test_random_actions_under_action_masks_are_legal_through_partial_resets():
    """ActionMask reads the mask of `_reset`: rows that are not reset must show their own there.

    With a hand this narrow some cell is always open to every pick, so the stock transform suffices.
    """
    narrow = Reach(Layout.grid(6, 6, 0.12), clearance_m=0.08, half_fan_deg=5.0, n_sectors=10)
    env = TransformedEnv(make_env(narrow, 256, 9), ActionMask(keys.PICK, keys.PICK_MASK))
    env.append_transform(ActionMask(keys.PLACE, keys.PLACE_MASK))
    env.set_seed(3)
    torch.manual_seed(0)
    rollout = env.rollout(12, break_when_any_done=False)
    done = rollout["next", keys.DONE]
    assert done[:, :-1].any(), "no partial reset was seen"
    refused = (rollout["next", keys.FAILURE] >= Failure.PICK) & (rollout["next", keys.FAILURE] <= Failure.GO_BACK)
    assert not refused.any()


def test_partial_reset_leaves_the_other_rows_alone():
    env = make_env(wide_hand(4, 6), 32, 6)
    generator = torch.Generator().manual_seed(0)
    shown = env.reset()
    shown = env.step(random_legal(env, shown, generator))["next"]
    ask = torch.zeros(32, 1, dtype=torch.bool)
    ask[::3] = True
    before, state = shown.clone(), env.state_dict()
    after = env.reset(shown.clone().set("_reset", ask))
    others = ~ask.squeeze(-1)
    for key in (keys.BOARD, keys.TARGET, keys.VISITED, keys.PICK_MASK, keys.PLACE_MASK):
        assert torch.equal(after[key][others], before[key][others]), key
    assert not torch.equal(after[keys.BOARD][~others], before[keys.BOARD][~others])
    assert torch.equal(env.state_dict()["moves"][others], state["moves"][others])
    assert (env.state_dict()["moves"][~others] == 0).all()


def test_same_seed_same_episodes():
    def play(seed: int):
        env = make_env(wide_hand(3, 6), 16, 6)
        env.set_seed(seed)
        generator = torch.Generator().manual_seed(1)
        shown, boards = env.reset(), []
        for _ in range(10):
            step, shown = env.step_and_maybe_reset(random_legal(env, shown, generator))
            boards.append(step[keys.BOARD])
        return torch.stack(boards)

    assert torch.equal(play(5), play(5))
    assert not torch.equal(play(5), play(6))


def test_batch_equals_rows_one_by_one():
    """Row b of a batched step is the step of instance b alone: no row leaks into another."""
    reach = wide_hand(4, 5)
    instances = InstanceSet.generate(reach, 24, make_env(reach, 1, 7).source.difficulty, "train", 0)
    rows = torch.randint(20, (2, 24), generator=torch.Generator().manual_seed(2))

    def step(batch: Batch, pick, place):
        env = RearrangeEnv(reach, Given(batch), len(batch.target), 4, REWARDS)
        return env.step(env.reset().set(keys.PICK, pick).set(keys.PLACE, place))["next"]

    many = step(instances.batch(), *rows)
    for row in range(24):
        alone = step(instances.batch(slice(row, row + 1)), *rows[:, row : row + 1])
        for key in (keys.BOARD, keys.PICK_MASK, keys.PLACE_MASK, keys.PICK_REWARD, keys.PLACE_REWARD, keys.FAILURE):
            assert torch.equal(alone[key][0], many[key][row]), (row, key)


class Given:
    """A source that always gives the same batch."""

    def __init__(self, batch: Batch) -> None:
        self.batch = batch

    def draw(self, n: int) -> Batch:
        return Batch(self.batch.board[:n], self.batch.target[:n])

    def seed(self, seed: int) -> None: ...

    def state_dict(self):
        return {}

    def load_state_dict(self, state) -> None: ...


def board_of(reach, *cells: int):
    occupied = torch.zeros(1, reach.n_cells, dtype=torch.bool)
    occupied[0, list(cells)] = True
    return pack(occupied)


@pytest.mark.parametrize(
    ("pick", "place", "failure", "pick_reward", "place_reward", "done"),
    [
        # Cell ids from 0 on 3 x 3: the target is 7 (far row, middle), 4 stands in front of it, 1 before that.
        (1, 0, Failure.NONE, 0.0, 0.0, False),
        (4, 0, Failure.PICK, -1.0, -1.0, True),
        (0, 2, Failure.PICK, -1.0, -1.0, True),
        (1, 4, Failure.PLACE, 0.0, -1.0, True),
        (1, 7, Failure.PLACE, 0.0, -1.0, True),
        (4, 1, Failure.PICK_AND_PLACE, -1.0, -1.0, True),
        (1, 1, Failure.GO_BACK, 0.0, -1.0, True),
    ],
)
def test_failures_and_rewards(pick, place, failure, pick_reward, place_reward, done):
    reach = wide_hand(3, 3)
    env = RearrangeEnv(reach, Given(Batch(board_of(reach, 1, 4), torch.tensor([7]))), 1, 8, REWARDS)
    shown = env.reset().set(keys.PICK, torch.tensor([pick])).set(keys.PLACE, torch.tensor([place]))
    after = env.step(shown)["next"]
    assert Failure(int(after[keys.FAILURE])) is failure
    assert float(after[keys.PICK_REWARD]) == pick_reward
    assert float(after[keys.PLACE_REWARD]) == place_reward
    assert bool(after[keys.TERMINATED]) == done == bool(after[keys.DONE])
    if done:
        assert torch.equal(after[keys.BOARD], shown[keys.BOARD]), "a refused move changes nothing"


def test_lift_that_frees_the_target_pays_the_pick_and_solving_ends_the_episode():
    reach = wide_hand(3, 3)
    env = RearrangeEnv(reach, Given(Batch(board_of(reach, 4), torch.tensor([7]))), 1, 8, REWARDS)
    shown = env.reset().set(keys.PICK, torch.tensor([4])).set(keys.PLACE, torch.tensor([3]))
    after = env.step(shown)["next"]
    assert float(after[keys.PICK_REWARD]) == 10.0
    # Cell 3 is a column aside: with this hand the lane to the target is still blocked.
    assert float(after[keys.PLACE_REWARD]) in (0.0, 10.0)
    wide = wide_hand(3, 5)
    env = RearrangeEnv(wide, Given(Batch(board_of(wide, 7), torch.tensor([12]))), 1, 8, REWARDS)
    after = env.step(env.reset().set(keys.PICK, torch.tensor([7])).set(keys.PLACE, torch.tensor([5])))["next"]
    assert float(after[keys.PLACE_REWARD]) == 10.0
    assert bool(after[keys.TERMINATED])
    assert int(after[keys.FAILURE]) == Failure.NONE


def test_step_limit_truncates():
    env = make_env(wide_hand(5, 5), 64, 9, max_moves=1)
    step = env.step(random_legal(env, env.reset(), torch.Generator().manual_seed(0)))["next"]
    assert torch.equal(step[keys.DONE], step[keys.TERMINATED] | step[keys.TRUNCATED])
    assert step[keys.DONE].all()
    assert not (step[keys.TERMINATED] & step[keys.TRUNCATED]).any()
    assert step[keys.TRUNCATED].any()


def test_no_legal_move_left_ends_the_episode():
    """On one column each cell hides those behind it: an episode that shuffles to and fro runs out of boards."""
    reach = wide_hand(4, 1)
    env = RearrangeEnv(reach, Given(Batch(board_of(reach, 1, 2), torch.tensor([3]))), 1, 8, REWARDS)
    shown = env.reset()
    assert shown[keys.PICK_MASK][0].tolist() == [False, True, False, False]
    after = env.step(shown.set(keys.PICK, torch.tensor([1])).set(keys.PLACE, torch.tensor([0])))["next"]
    assert int(after[keys.FAILURE]) == Failure.NO_LEGAL_MOVE
    assert bool(after[keys.TERMINATED])
    assert float(after[keys.PLACE_REWARD]) == -1.0


def test_state_dict_goes_on_as_the_original():
    env, other = make_env(wide_hand(3, 6), 32, 6), make_env(wide_hand(3, 6), 32, 6, seed=9)
    generator = torch.Generator().manual_seed(0)
    shown = env.reset()
    for _ in range(4):
        _, shown = env.step_and_maybe_reset(random_legal(env, shown, generator))
    other.load_state_dict(env.state_dict())
    again, seed = other.observation(), generator.get_state()
    for _ in range(4):
        _, shown = env.step_and_maybe_reset(random_legal(env, shown, generator))
    generator.set_state(seed)
    for _ in range(4):
        _, again = other.step_and_maybe_reset(random_legal(other, again, generator))
    assert torch.equal(shown[keys.BOARD], again[keys.BOARD])
    assert torch.equal(shown[keys.VISITED], again[keys.VISITED])


def test_a_set_gives_only_its_own_instances():
    reach = wide_hand(3, 6)
    instances = InstanceSet.generate(reach, 20, make_env(reach, 1, 6).source.difficulty, "train", 0)
    env = RearrangeEnv(reach, FixedInstances(instances, seed=0), 64, 8, REWARDS)
    known = set(zip(instances.board[:, 0].tolist(), instances.target.tolist(), strict=True))
    shown = env.reset()
    assert set(zip(shown[keys.BOARD][:, 0].tolist(), shown[keys.TARGET].tolist(), strict=True)) <= known


@pytest.mark.parametrize(
    ("change", "says"),
    [({"num_envs": 0}, "env.num_envs: got 0"), ({"max_moves": 0}, "env.max_moves: got 0")],
)
def test_bad_arguments(change, says):
    reach = wide_hand(3, 3)
    keywords = {"num_envs": 1, "max_moves": 1, "rewards": REWARDS} | change
    with pytest.raises(InputError, match=says):
        RearrangeEnv(reach, Given(Batch(board_of(reach, 1), torch.tensor([7]))), **keywords)


def test_bad_rewards():
    with pytest.raises(InputError, match=r"env\.rewards\.solved: got nan"):
        Rewards(solved=float("nan"), unfinished=0.0, failed=-1.0)
    with pytest.raises(InputError, match="solved -1 is not above failed 0"):
        Rewards(solved=-1.0, unfinished=0.0, failed=0.0)
