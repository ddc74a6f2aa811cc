"""The TorchRL environment: specs, rewards, ends of episodes, and the mask traps."""

from __future__ import annotations

import pytest
import torch
from torchrl.collectors import Collector
from torchrl.envs import ActionMask, TransformedEnv, check_env_specs

from dore.errors import InputError
from dore.learn import keys
from dore.learn.env import RearrangeEnv, Rewards
from dore.world.instances import FixedInstances, InstanceSet
from dore.world.layout import Layout
from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.rules import Failure
from tests.drawings import wide_hand
from tests.worlds import REWARDS, Given, board_of, make_agent, make_env, random_legal


@pytest.mark.parametrize("size", [(3, 6, 0.12), (10, 10, 0.09)])
def test_specs(size):
    check_env_specs(make_env(wide_hand(*size), num_envs=7, most=9))


def test_specs_with_action_masks():
    check_env_specs(TransformedEnv(make_env(wide_hand(3, 6), 16, 9), ActionMask(keys.PICK, keys.LEGAL_PICK)))


def test_random_picks_under_an_action_mask_are_legal_through_partial_resets():
    """ActionMask reads the mask of `_reset`: rows that are not reset must show their own there."""
    narrow = Reach(Layout.grid(6, 6, 0.12), clearance_m=0.08, half_fan_deg=5.0, n_sectors=10)
    env = TransformedEnv(make_env(narrow, 256, 9), ActionMask(keys.PICK, keys.LEGAL_PICK))
    env.set_seed(3)
    torch.manual_seed(0)
    rollout = env.rollout(12, break_when_any_done=False)
    done = rollout["next", keys.DONE]
    assert done[:, :-1].any(), "no partial reset was seen"
    failures = set(rollout["next", keys.FAILURE].flatten().tolist())
    assert Failure.PLACE in failures, "places are drawn without a mask"
    assert failures.isdisjoint({Failure.PICK, Failure.PICK_AND_PLACE})


def test_actions_alone_are_enough_for_a_step():
    env, same = make_env(wide_hand(3, 6), 8, 6), make_env(wide_hand(3, 6), 8, 6)
    acted = random_legal(env, env.reset(), torch.Generator().manual_seed(0))
    same.reset()
    alone = same.step(acted.select(keys.PICK, keys.PLACE))
    assert torch.equal(alone["next", keys.BOARD], env.step(acted)["next", keys.BOARD])


def test_a_stock_collector_runs_a_policy_in_it():
    reach = wide_hand(3, 6)
    env, agent = make_env(reach, 16, 6), make_agent("sequential", False, reach)
    agent.set_epsilon(0.5)
    collector = Collector(env, agent.policy, frames_per_batch=160, total_frames=480)
    failures = torch.cat([batch["next", keys.FAILURE].flatten() for batch in collector])
    collector.shutdown()
    assert len(failures) == 480
    assert set(failures.tolist()) <= {Failure.NONE, Failure.NO_LEGAL_MOVE}


def test_same_seed_same_episodes():
    def play(seed: int):
        env = make_env(wide_hand(3, 6), 16, 6)
        env.set_seed(seed)
        generator = torch.Generator().manual_seed(1)
        observation, boards = env.reset(), []
        for _ in range(10):
            step, observation = env.step_and_maybe_reset(random_legal(env, observation, generator))
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
        env = RearrangeEnv(reach, Given(reach, batch), len(batch.target), 4, REWARDS)
        return env.step(env.reset().set(keys.PICK, pick).set(keys.PLACE, place))["next"]

    many = step(instances.batch(), *rows)
    for row in range(24):
        alone = step(instances.batch(slice(row, row + 1)), *rows[:, row : row + 1])
        for key in (keys.BOARD, keys.LEGAL_PICK, keys.PICKABLE, keys.PICK_REWARD, keys.PLACE_REWARD, keys.FAILURE):
            assert torch.equal(alone[key][0], many[key][row]), (row, key)


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
    env = RearrangeEnv(reach, Given(reach, Batch(board_of(reach, 1, 4), torch.tensor([7]))), 1, 8, REWARDS)
    observation = env.reset().set(keys.PICK, torch.tensor([pick])).set(keys.PLACE, torch.tensor([place]))
    after = env.step(observation)["next"]
    assert Failure(int(after[keys.FAILURE])) is failure
    assert float(after[keys.PICK_REWARD]) == pick_reward
    assert float(after[keys.PLACE_REWARD]) == place_reward
    assert bool(after[keys.TERMINATED]) == done == bool(after[keys.DONE])
    if done:
        assert torch.equal(after[keys.BOARD], observation[keys.BOARD]), "a refused move changes nothing"


def test_lift_that_frees_the_target_pays_the_pick_and_solving_ends_the_episode():
    reach = wide_hand(3, 3)
    env = RearrangeEnv(reach, Given(reach, Batch(board_of(reach, 4), torch.tensor([7]))), 1, 8, REWARDS)
    # The lift frees the target; placed on cell 1, the obstacle blocks it again.
    observation = env.reset().set(keys.PICK, torch.tensor([4])).set(keys.PLACE, torch.tensor([1]))
    after = env.step(observation)["next"]
    assert float(after[keys.PICK_REWARD]) == 10.0
    assert float(after[keys.PLACE_REWARD]) == 0.0
    assert not bool(after[keys.TERMINATED])
    wide = wide_hand(3, 5)
    env = RearrangeEnv(wide, Given(wide, Batch(board_of(wide, 7), torch.tensor([12]))), 1, 8, REWARDS)
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
    env = RearrangeEnv(reach, Given(reach, Batch(board_of(reach, 1, 2), torch.tensor([3]))), 1, 8, REWARDS)
    observation = env.reset()
    assert observation[keys.LEGAL_PICK][0].tolist() == [False, True, False, False]
    after = env.step(observation.set(keys.PICK, torch.tensor([1])).set(keys.PLACE, torch.tensor([0])))["next"]
    assert int(after[keys.FAILURE]) == Failure.NO_LEGAL_MOVE
    assert bool(after[keys.TERMINATED])
    assert float(after[keys.PLACE_REWARD]) == -1.0


def test_a_set_gives_only_its_own_instances():
    reach = wide_hand(3, 6)
    instances = InstanceSet.generate(reach, 20, make_env(reach, 1, 6).source.difficulty, "train", 0)
    env = RearrangeEnv(reach, FixedInstances(instances, seed=0), 64, 8, REWARDS)
    known = set(zip(instances.board[:, 0].tolist(), instances.target.tolist(), strict=True))
    observation = env.reset()
    assert set(zip(observation[keys.BOARD][:, 0].tolist(), observation[keys.TARGET].tolist(), strict=True)) <= known


@pytest.mark.parametrize(
    ("change", "says"),
    [({"num_envs": 0}, "env.num_envs: got 0"), ({"max_moves": 0}, "env.max_moves: got 0")],
)
def test_bad_arguments(change, says):
    reach = wide_hand(3, 3)
    keywords = {"num_envs": 1, "max_moves": 1, "rewards": REWARDS} | change
    with pytest.raises(InputError, match=says):
        RearrangeEnv(reach, Given(reach, Batch(board_of(reach, 1), torch.tensor([7]))), **keywords)


def test_bad_rewards():
    with pytest.raises(InputError, match=r"env\.rewards\.solved: got nan"):
        Rewards(solved=float("nan"), unfinished=0.0, failed=-1.0)
    with pytest.raises(InputError, match="solved -1 is not above failed 0"):
        Rewards(solved=-1.0, unfinished=0.0, failed=0.0)
