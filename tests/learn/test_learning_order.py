"""What is stored, drawn and learned, and in which order: that of one environment, however many there are."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict
from torchrl.data import LazyTensorStorage, ReplayBuffer, SamplerWithoutReplacement

from dore.errors import InputError
from dore.learn import keys
from dore.learn.player import Burst, Player
from dore.learn.replay import draw_in_order, restore
from dore.learn.trainer import MAIN, Trainer
from dore.world.rules import lift, retrievable
from tests.drawings import wide_hand
from tests.learn.runs import literal
from tests.worlds import make_agent, make_env


def numbered(n: int, first: int = 0) -> TensorDict:
    return TensorDict({"id": torch.arange(first, first + n)}, batch_size=[n])


@pytest.mark.parametrize("held", [0, 3, 25])
def test_draws_see_what_is_stored_by_then_and_nothing_that_is_written_over(held):
    """A replay of 8: the k-th draw is uniform over the last 8 rows of those stored until then."""
    torch.manual_seed(0)
    buffer = ReplayBuffer(storage=LazyTensorStorage(8), batch_size=1)
    for row in range(held):
        buffer.extend(numbered(1, row))
    stored = torch.tensor([1, 4, 5, 9, 14])
    drawn = draw_in_order(buffer, numbered(14, held), stored, 4000)["id"].view(5, 4000)
    assert len(buffer) == min(held, 8)
    for ids, last in zip(drawn, (held + stored).tolist(), strict=True):
        window = set(range(max(0, last - 8), last))
        counts = torch.bincount(ids - min(window))
        assert set(ids.tolist()) == window
        assert counts.min() > 0.8 * 4000 / len(window)


def test_a_sampler_that_is_not_uniform_is_refused():
    """Drawing in order knows no other; and nothing would write priorities back."""
    buffer = ReplayBuffer(storage=LazyTensorStorage(8), sampler=SamplerWithoutReplacement(), batch_size=1)
    with pytest.raises(InputError, match="got SamplerWithoutReplacement, want RandomSampler"):
        draw_in_order(buffer, numbered(3), torch.tensor([1]), 2)


@pytest.mark.parametrize("num_envs", [1, 7])
def test_an_episode_is_returned_whole_when_it_has_ended(num_envs):
    torch.manual_seed(0)
    reach = wide_hand(3, 4)
    env = make_env(reach, num_envs, 5, max_moves=4)
    player = Player(env, make_agent("sequential", True, reach), "episode")
    player.reset()
    lengths = []
    for _ in range(60):
        burst = player.play(epsilon=1.0)
        assert burst.episodes.tolist() == list(range(1, len(burst.stored) + 1))
        for k in range(len(burst.stored)):
            episode = burst.split(k)[1].split(1)[0].rows
            lengths.append(len(episode))
            assert torch.equal(episode[keys.BOARD][1:], episode["next", keys.BOARD][:-1])
            ended = episode["next", keys.TERMINATED].squeeze(-1).tolist()
            assert ended[:-1] == [False] * (len(episode) - 1)
            assert ended[-1] or len(episode) == 4, "only the step limit ends an episode that has not terminated"
    assert {1, 2} < set(lengths)
    assert sum(lengths) + int(player._length.sum()) == 60 * num_envs, "no step is lost or there twice"


def one_after_the_other(trainer: Trainer, burst: Burst) -> None:
    """Algorithm 2, lines 3-5, a line at a time: store an episode, draw, learn, and the next."""
    for k in range(len(burst.stored)):
        trainer.worlds[MAIN].buffer.extend(burst.split(k)[1].split(1)[0].rows)
        age = (torch.rand(1, trainer.budget.batch_size, dtype=torch.float64) * len(trainer.worlds[MAIN].buffer)).long()
        sample = trainer.worlds[MAIN].buffer[len(trainer.worlds[MAIN].buffer) - 1 - age.flatten()]
        agent = trainer.learner.agent
        trainer.learner.update(agent.decode(restore(sample)), agent)


@pytest.mark.parametrize(
    ("paper", "num_envs", "more"),
    [
        ("sequential", 1, []),
        ("sequential", 9, []),
        ("single", 1, []),
        ("single", 9, []),
        ("sequential", 9, ["agent.double=true"]),
        ("sequential", 9, ["target_update=soft"]),
    ],
)
def test_many_environments_store_and_learn_in_the_order_of_one(paper, num_envs, more, monkeypatch):
    """It draws, decodes and works out targets for many updates at once; the weights are those of one by one."""
    options = (paper, f"env.num_envs={num_envs}", "buffer.storage.max_size=5000", *more)
    trainer, by_the_book = literal(*options), literal(*options)
    learned: list[tuple[torch.Tensor, Burst]] = []
    learn = trainer._learn
    monkeypatch.setattr(
        trainer, "_learn", lambda world, burst: (learned.append((torch.get_rng_state(), burst)), learn(world, burst))
    )
    while trainer.progress.filled < 50:
        trainer.iterate()
    by_the_book.worlds[MAIN].buffer.extend(trainer.worlds[MAIN].buffer[:])
    while not trainer.spent():
        trainer.iterate()
    for state, burst in learned:
        torch.set_rng_state(state)
        one_after_the_other(by_the_book, burst)
    assert len(trainer.worlds[MAIN].buffer) == len(by_the_book.worlds[MAIN].buffer)
    assert all(torch.equal(a, b) for a, b in zip(*(rows_of(one) for one in (trainer, by_the_book)), strict=True))
    weights = [one.learner.agent.networks.state_dict() for one in (trainer, by_the_book)]
    for name, value in weights[0].items():
        torch.testing.assert_close(value, weights[1][name], rtol=1e-4, atol=1e-5)


def rows_of(trainer: Trainer) -> list[torch.Tensor]:
    return [value for _, value in sorted(trainer.worlds[MAIN].buffer[:].flatten_keys(".").items())]


def test_what_a_decoded_step_says_of_its_pick():
    """The pick's chain ends where the pick failed, or where the lift opened the target; only a true pick is placed."""
    torch.manual_seed(0)
    reach = wide_hand(3, 4)
    agent = make_agent("sequential", True, reach)
    player = Player(make_env(reach, 200, 6), agent, "round")
    player.reset()
    step = player.env.step(random_cells(player, reach.n_cells))
    decoded = agent.decode(step)
    failed = torch.isin(step["next", keys.FAILURE], torch.tensor([1, 3]))
    opened = retrievable(reach, lift(step[keys.BOARD], step[keys.PICK]), step[keys.TARGET])
    assert torch.equal(decoded[keys.PICKED], ~failed)
    assert torch.equal(decoded["lifted", keys.TERMINATED].squeeze(-1), failed | opened)
    assert {True, False} == set(failed.tolist()) == set((opened & ~failed).tolist())


def random_cells(player: Player, n_cells: int) -> TensorDict:
    """An action of any two cells in every environment."""
    observed = player.env.observation()
    n = observed.batch_size[0]
    observed[keys.PICK], observed[keys.PLACE] = torch.randint(n_cells, (n,)), torch.randint(n_cells, (n,))
    return observed
