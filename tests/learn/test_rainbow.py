"""Prioritised replay, n-step returns and dueling heads: what each computes, and that a run has them to its end."""

from __future__ import annotations

from functools import partial

import pytest
import torch
from tensordict import TensorDict
from torchrl.data import LazyTensorStorage, ReplayBuffer

from dore.errors import InputError
from dore.learn import keys
from dore.learn.dueling import Dueling
from dore.learn.n_step import n_step_rows
from dore.learn.networks import MLP, CellNet
from dore.learn.player import Player
from dore.learn.prioritized import Prioritized
from dore.learn.replay import draw, restore
from tests.commands import TINY, run
from tests.drawings import wide_hand
from tests.learn.runs import same, stopped_and_resumed
from tests.learn.test_learner import learner
from tests.learn.test_losses import sequential, transition
from tests.worlds import make_agent, make_env

GAMMA = 0.5


def episodes(*rewards: list[float], terminated: bool = True) -> tuple[TensorDict, torch.Tensor]:
    """Padded rows of episodes with these rewards; the board after the move t of episode e is 10 e + t + 1."""
    lengths, longest = torch.tensor([len(one) for one in rewards]), max(len(one) for one in rewards)
    shape = (len(rewards), longest)
    boards = 10 * torch.arange(len(rewards))[:, None] + torch.arange(longest)
    ends = torch.arange(longest) == lengths[:, None] - 1
    padded = torch.tensor([one + [99.0] * (longest - len(one)) for one in rewards])
    after = {keys.BOARD: boards + 1, keys.TERMINATED: (ends & terminated)[..., None]}
    rows = TensorDict({keys.BOARD: boards, "next": after}, batch_size=shape)
    rows["next", *keys.PLACE_REWARD] = padded[..., None]
    return rows, lengths


@pytest.mark.parametrize("terminated", [True, False])
@pytest.mark.parametrize("n", [2, 3, 7])
def test_returns_of_several_moves_are_those_of_a_plain_loop(n, terminated):
    played = [[1.0, 2.0, 4.0, 8.0, 16.0], [3.0], [5.0, 6.0]]
    rows, lengths = episodes(*played, terminated=terminated)
    before = rows.clone()
    found = n_step_rows(rows, lengths, n, GAMMA)
    for e, rewards in enumerate(played):
        for t in range(len(rewards)):
            ahead = rewards[t : t + n]
            row = found[e, t]
            assert row["next", *keys.PLACE_REWARD].item() == sum(GAMMA**k * one for k, one in enumerate(ahead))
            assert row["next", keys.BOARD].item() == 10 * e + t + len(ahead)
            assert row["next", keys.TERMINATED].item() == (terminated and t + len(ahead) == len(rewards))
            assert row[keys.STEPS].item() == len(ahead)
            assert row[keys.BOARD].item() == 10 * e + t
    assert (rows == before).all(), "the rows themselves stay"


def test_what_follows_is_discounted_by_as_many_moves():
    of_one, of_three = transition(False), transition(False)
    of_three["next"][keys.STEPS] = torch.tensor([3], dtype=torch.uint8)
    loss = sequential("natural")
    ahead = [loss.with_targets(one)["place", "target"].item() for one in (of_one, of_three)]
    assert ahead == [7.0 + 0.5 * 3.0, 7.0 + 0.125 * 3.0]


@pytest.mark.parametrize("kind", ["sequential", "single"])
def test_the_player_keeps_whole_episodes_for_them(kind):
    reach = wide_hand(3, 4)
    agent = make_agent(kind, False, reach)
    agent.n_steps = 3
    player = Player(make_env(reach, 5, 4, max_moves=4), agent, "round")
    player.reset()
    bursts = [player.play(epsilon=1.0) for _ in range(12)]
    rows = torch.cat([burst.rows for burst in bursts])
    assert sum(int(burst.episodes[-1]) for burst in bursts) > 5
    assert 1 <= rows[keys.STEPS].min() < rows[keys.STEPS].max() <= 3
    decoded = agent.decode(
        rows.clone().to_tensordict().apply(lambda one: one.long() if one.dtype is torch.uint8 else one)
    )
    assert decoded["next", keys.STEPS].tolist() == rows[keys.STEPS].tolist()


def buffer_of(n: int, alpha: float = 1.0, beta: float = 1.0) -> ReplayBuffer:
    made = ReplayBuffer(storage=LazyTensorStorage(8), sampler=Prioritized(alpha, beta), batch_size=None)
    made.extend(TensorDict({"id": torch.arange(n)}, batch_size=[n]))
    return made


def test_what_was_learned_worst_is_drawn_most():
    torch.manual_seed(0)
    buffer = buffer_of(4)
    buffer.update_priority(torch.arange(4), torch.tensor([1.0, 2.0, 0.0, 5.0]))
    drawn, info = buffer.sample(8000, return_info=True)
    shares = torch.bincount(drawn["id"], minlength=4) / 8000
    torch.testing.assert_close(shares, torch.tensor([0.125, 0.25, 0.0, 0.625]), atol=0.02, rtol=0)
    weights = dict(zip(drawn["id"].tolist(), info["priority_weight"].tolist(), strict=True))
    assert weights[0] == pytest.approx(2 * weights[1], rel=1e-3)


def test_a_new_transition_has_the_highest_priority_also_where_an_old_one_was():
    torch.manual_seed(0)
    buffer = buffer_of(8)
    buffer.update_priority(torch.arange(8), torch.tensor([9.0, *[1e-6] * 7]))
    buffer.extend(TensorDict({"id": torch.tensor([100, 101])}, batch_size=[2]))
    drawn = buffer.sample(2000)["id"]
    assert set(drawn.tolist()) == {100, 101}, "0, which had a priority of 9, was overwritten"


def test_transitions_that_are_added_one_by_one_are_drawn_too():
    torch.manual_seed(0)
    buffer = ReplayBuffer(storage=LazyTensorStorage(8), sampler=Prioritized(0.5, 0.5))
    for one in range(3):
        buffer.add(TensorDict({"id": torch.tensor(one)}))
    assert set(buffer.sample(100)["id"].tolist()) == {0, 1, 2}


def test_alpha_0_is_uniform_and_bad_shares_are_refused():
    torch.manual_seed(0)
    buffer = buffer_of(4, alpha=0.0)
    buffer.update_priority(torch.arange(4), torch.tensor([1.0, 2.0, 0.0, 5.0]))
    assert torch.bincount(buffer.sample(8000)["id"]).min() > 1800
    with pytest.raises(InputError, match=r"buffer.sampler.alpha: got 2"):
        Prioritized(2, 0.5)


def test_the_errors_of_an_update_become_priorities_row_by_row():
    made, reach = learner(None), wide_hand(3, 4)
    made.agent.symmetry = False
    for group in made.optimizer.param_groups:
        group["lr"] = 0.0
    player = Player(make_env(reach, 12, 4), made.agent, "round")
    player.reset()
    buffer = ReplayBuffer(storage=LazyTensorStorage(16), sampler=Prioritized(1.0, 0.5))
    buffer.extend(player.play(1.0).rows)
    sample = restore(draw(buffer, 12))
    made.learn(sample, made.agent)
    for row in range(12):
        alone = made.agent.decode(sample[row : row + 1].exclude(keys.WEIGHT, keys.ERROR))
        made.agent.loss(alone)
        torch.testing.assert_close(sample[keys.ERROR][row], alone[keys.ERROR][0])
    buffer.update_priority(sample[keys.INDEX], sample[keys.ERROR].squeeze(-1))
    kept = buffer.sampler.state_dict()["shares"]
    torch.testing.assert_close(kept[sample[keys.INDEX]], sample[keys.ERROR].squeeze(-1))


def test_weights_where_no_pick_succeeded_are_no_reason_to_diverge():
    loss, batch = sequential("natural"), transition(False, picked=False)
    batch[keys.WEIGHT] = torch.tensor([0.5])
    found = loss(batch)
    assert found["loss_place"].item() == 0.0
    assert found["loss_pick"].isfinite()


@pytest.mark.parametrize("more", ["buffer=prioritized", "agent.n_steps=3"])
def test_a_run_does_not_go_on_with_another_part(tmp_path, capsys, more):
    common = [*TINY, "training.max_episodes=30", f"run_dir={tmp_path / 'run'}"]
    assert run("train", common) == 0
    assert run("train", [*common, more, "existing=continue", "training.max_episodes=60"]) == 2
    assert "was started with" in capsys.readouterr().err


def test_transfer_follows_each_move_also_with_a_model_of_several(tmp_path):
    assert run("train", [*TINY, "agent.n_steps=3", "training.max_episodes=30", f"run_dir={tmp_path / 'run'}"]) == 0
    options = ["planner=transfer", f"model={tmp_path / 'run'}", "limit=20", "planners.transfer.max_seconds=1"]
    assert run("evaluate", [*options, "instances=z3-7", "instances.test_size=20"]) == 0


@pytest.mark.parametrize("options", [["buffer=prioritized", "agent.n_steps=3"]])
def test_interrupted_and_resumed_it_is_the_same_run(tmp_path, options):
    common = [*TINY, *options, "training.max_episodes=100", "ipt.every_episodes=30"]
    whole, parts = stopped_and_resumed(tmp_path, common, iteration=9)
    assert same(whole, parts)


def test_a_transition_counts_by_its_weight():
    reach = wide_hand(3, 4)
    player = Player(make_env(reach, 8, 4), make_agent("sequential", False, reach), "round")
    player.reset()
    rows = restore(player.play(1.0).rows[:4].to_tensordict())
    first, weights = rows[[0, 0, 0, 0]], torch.tensor([1.0, 0.0, 0.0, 0.0])
    moved = []
    for sample, weight in ((rows, weights), (first, torch.ones(4))):
        made = learner(None)
        made.agent.symmetry = False
        sample[keys.WEIGHT] = weight
        made.learn(sample, made.agent)
        moved.append([one.detach() for one in made.agent.networks.parameters()])
    assert rows[keys.ERROR].shape == (4, 1)
    for of_all, of_first in zip(*moved, strict=True):
        torch.testing.assert_close(of_all, of_first)


def test_a_dueling_head_is_a_value_and_advantages_of_mean_0():
    reach = wide_hand(3, 4)
    made = Dueling(reach, n_planes=2, n_outputs=(12, 5), body=partial(MLP, widths=[8]))
    planes = torch.rand(6, 2, 12)
    cells, slots = made(planes)
    advantage, value, *_ = made.body(planes)
    assert (cells.shape, slots.shape) == ((6, 12), (6, 5))
    torch.testing.assert_close(cells.mean(-1), value.mean(-1))
    torch.testing.assert_close(cells - cells[:, :1], advantage - advantage[:, :1])
    assert not made.serves_every_layout


def test_dueling_heads_need_a_network():
    with pytest.raises(InputError, match=r"network\.body: got None, want a network"):
        Dueling(wide_hand(3, 4), n_planes=2, n_outputs=(12,), body=None)


def test_a_dueling_network_serves_the_layouts_that_its_body_serves():
    small, large = wide_hand(3, 4), wide_hand(5, 5)
    made = Dueling(small, n_planes=2, n_outputs=(12,), body=partial(CellNet, width=8, blocks=1))
    assert made.serves_every_layout
    there = made.on(large)
    assert there(torch.rand(2, 2, 25))[0].shape == (2, 25)
    assert all(a is b for a, b in zip(made.parameters(), there.parameters(), strict=True))


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (
            ["buffer=prioritized", "training.update_after=step"],
            "buffer.sampler: got Prioritized, want RandomSampler with",
        ),
        (["buffer=prioritized", "teacher=imitation"], "want RandomSampler with a teacher"),
        (["agent.n_steps=2", "agent.chain=literal"], "agent.n_steps: got 2, want 1 with agent.chain=literal"),
        (["agent.n_steps=2", "teacher=demonstrations"], "agent.n_steps: got 2, want 1 with a teacher"),
        (["agent.n_steps=2", "training.update_after=step"], "want 1 with training.update_after=step"),
        (
            ["buffer=prioritized", "buffer.sampler.alpha=-1"],
            "want a finite number of 0 or more and at most 1",
        ),
        (["agent.n_steps=0"], "agent.n_steps: got 0"),
    ],
)
def test_what_they_do_not_go_with_is_one_line(tmp_path, capsys, options, says):
    assert run("train", [*TINY, *options, f"run_dir={tmp_path / 'run'}"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert says in line
    assert not (tmp_path / "run").exists()
