"""Algorithm 2 as printed: the fill counts for nothing, then an update follows each episode, in one order."""

from __future__ import annotations

import json
import signal

import hydra
import pytest
import torch
from hydra.core.global_hydra import GlobalHydra
from tensordict import TensorDict
from torchrl.data import LazyTensorStorage, ReplayBuffer, SamplerWithoutReplacement

from dore.app import session
from dore.app.training import trainer_of
from dore.errors import InputError
from dore.files import conf_dir
from dore.learn import keys
from dore.learn.checkpoint import BEST_NAME, load_checkpoint, load_model
from dore.learn.losses import PICKED
from dore.learn.player import Burst, Player
from dore.learn.replay import draw_in_order, restore
from dore.learn.trainer import MAIN, Trainer
from dore.world.rules import lift, retrievable
from tests.commands import TINY, run
from tests.drawings import wide_hand
from tests.learn.test_trainer import metrics, same
from tests.worlds import make_agent, make_env

LITERAL = [
    *(option for option in TINY if not option.startswith(("agent.", "training.", "layout."))),
    *("layout.rows=3", "layout.cols=4", "instances.train_size=40", "training.fill=50", "training.batch_size=4"),
    *("training.max_episodes=60", "target_update.value_network_update_interval=9"),
]
"""A tiny run of the paper's preset; its targets are copied every 10 updates."""


def literal(paper: str, *overrides: str) -> Trainer:
    GlobalHydra.instance().clear()
    soft = "target_update=soft" in overrides
    options = [option for option in LITERAL if not (soft and option.startswith("target_update."))]
    with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
        return trainer_of(hydra.compose("train", [f"experiment=paper/{paper}", *options, *overrides]))


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
def test_an_episode_is_handed_over_whole_when_it_has_ended(num_envs):
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
        trainer.learner.update(trainer.learner.agent.decode(restore(sample)))


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


@pytest.mark.parametrize("unit", ["episode", "step"])
def test_the_fill_counts_for_nothing_and_each_unit_has_its_update(unit):
    trainer = literal("sequential", f"training.update_after={unit}", "env.num_envs=5")
    resets: list[int] = []
    reset = trainer.worlds[MAIN].player.reset
    trainer.worlds[MAIN].player.reset = lambda: (resets.append(trainer.progress.filled), reset())[1]
    while trainer.progress.filled < 50:
        trainer.iterate()
        assert trainer.learner.agent.choosers[0].explore.eps.item() == 1.0
    progress = trainer.progress
    assert (progress.filled, progress.env_steps, progress.episodes, progress.updates) == (50, 0, 0, 0)
    assert len(trainer.worlds[MAIN].buffer) == 50
    trainer.iterate()
    assert resets == [0, 50], "the first episode that counts is a new one"
    assert set(trainer.worlds[MAIN].player._length.tolist()) <= {0, 1}
    assert progress.epsilon == trainer.epsilon.start, "epsilon falls over what is played after the fill"
    while not trainer.spent():
        trainer.iterate()
    assert progress.episodes == 60, "not one more than T_lim"
    stored = len(trainer.worlds[MAIN].buffer) - 50
    assert progress.updates == (60 if unit == "episode" else stored)
    assert stored > 60


def test_an_ipt_comes_exactly_every_so_many_episodes(monkeypatch):
    """With twenty environments many episodes end at once; the weights tested are those after the n-th."""
    trainer = literal("sequential", "env.num_envs=20", "ipt.every_episodes=7")
    tested: list[tuple[int, int]] = []
    run_test = trainer.run_test
    monkeypatch.setattr(
        trainer,
        "run_test",
        lambda: (tested.append((trainer.progress.episodes, trainer.progress.updates)), run_test())[1],
    )
    trainer.run(lambda progress, result: None, stop=lambda: False)
    assert tested == [(n, n) for n in range(7, 60, 7)]


def test_the_last_model_is_returned_and_the_best_lies_beside_it(tmp_path):
    folder = tmp_path / "run"
    assert run("train", ["experiment=paper/sequential", *LITERAL, "ipt.every_episodes=5", f"run_dir={folder}"]) == 0
    last, _ = load_model(folder)
    networks = load_checkpoint(folder / "checkpoint.pt")["learner"]["loss"]
    assert all(torch.equal(value, networks[key_of(name)]) for name, value in last.items())
    best, _ = load_model(folder / BEST_NAME)
    assert best.keys() == last.keys()
    assert any(not torch.equal(value, last[name]) for name, value in best.items())
    done = json.loads((folder / "done.json").read_text())
    assert (done["episodes"], done["updates"], done["filled"]) == (60, 60, 50)
    assert done["best_success"] == max(float(row["success"]) for row in metrics(folder) if row["success"])


def key_of(name: str) -> str:
    """Where a checkpoint's loss keeps a weight of the networks."""
    head, *rest = name.split(".")
    return f"{head}_params." + ".".join(["module", *rest])


@pytest.mark.parametrize("stop_at", [2, 7, 10, 12])
def test_stopped_while_it_fills_or_learns_it_goes_on_as_if_it_had_not(tmp_path, stop_at, monkeypatch):
    report = session.Session._report

    def interrupted(self, progress, tested):
        report(self, progress, tested)
        if progress.iteration == stop_at:
            self._ask_to_stop(signal.SIGINT, None)

    common = ["experiment=paper/sequential", *LITERAL, "env.num_envs=20", "ipt.every_episodes=7"]
    assert run("train", [*common, f"run_dir={tmp_path / 'whole'}"]) == 0
    with monkeypatch.context() as patch:
        patch.setattr(session.Session, "_report", interrupted)
        assert run("train", [*common, f"run_dir={tmp_path / 'parts'}"]) == 130
    stopped = load_checkpoint(tmp_path / "parts" / "checkpoint.pt")
    assert (stopped["progress"]["updates"] == 0) == (stop_at == 2)
    assert run("train", [f"resume={tmp_path / 'parts'}"]) == 0
    whole, parts = (load_checkpoint(tmp_path / name / "checkpoint.pt") for name in ("whole", "parts"))
    assert same(whole, parts)
    assert metrics(tmp_path / "whole") == metrics(tmp_path / "parts")


def test_a_run_that_ends_while_it_fills_says_so(tmp_path, capsys):
    folder = tmp_path / "run"
    more = ["training.fill=300", "training.max_minutes=1e-6", f"run_dir={folder}"]
    assert run("train", ["experiment=paper/sequential", *LITERAL, *more]) == 0
    said = capsys.readouterr().out
    assert "nothing was learned: the replay holds" in said
    assert "of training.fill 300 transitions" in said
    assert "learning_curve" not in said
    done = json.loads((folder / "done.json").read_text(), parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    assert done["loss"] is None


def test_only_the_budget_changes_when_a_run_goes_on(tmp_path, capsys):
    folder = tmp_path / "run"
    assert run("train", ["experiment=paper/sequential", *LITERAL, "training.max_episodes=20", f"run_dir={folder}"]) == 0
    assert run("train", [f"resume={folder}", "training.fill=90"]) == 2
    assert "training.fill=90 cannot be changed" in capsys.readouterr().err


def test_a_killed_run_leaves_the_last_model_of_its_checkpoint(tmp_path, monkeypatch):
    """keep=last writes the model with each checkpoint."""
    monkeypatch.setattr(session.Session, "_conclude", lambda self, ending: None)
    assert run("train", ["experiment=paper/sequential", *LITERAL, f"run_dir={tmp_path / 'run'}"]) == 0
    last, _ = load_model(tmp_path / "run")
    networks = load_checkpoint(tmp_path / "run" / "checkpoint.pt")["learner"]["loss"]
    assert all(torch.equal(value, networks[key_of(name)]) for name, value in last.items())


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
    assert torch.equal(decoded[PICKED], ~failed)
    assert torch.equal(decoded["lifted", keys.TERMINATED].squeeze(-1), failed | opened)
    assert {True, False} == set(failed.tolist()) == set((opened & ~failed).tolist())


def random_cells(player: Player, n_cells: int) -> TensorDict:
    """An action of any two cells in every environment."""
    observed = player.env.observation()
    n = observed.batch_size[0]
    observed[keys.PICK], observed[keys.PLACE] = torch.randint(n_cells, (n,)), torch.randint(n_cells, (n,))
    return observed


def test_updates_begin_when_the_buffer_holds_enough():
    trainer = literal("sequential", "training.fill=0", "training.learning_starts=20", "training.update_after=step")
    first = None
    while not trainer.spent() and first is None:
        held = len(trainer.worlds[MAIN].buffer)
        trainer.iterate()
        if trainer.progress.updates:
            first = held + trainer.worlds[MAIN].env.batch_size[0] - trainer.progress.updates + 1
    assert first == 20


def test_no_test_before_the_first_update_and_none_ends_a_run_before_its_least_episodes():
    late = literal("sequential", "training.fill=0", "training.learning_starts=400", "ipt.every_episodes=5")
    tested: list[int] = []
    late.run(lambda progress, result: tested.extend([progress.episodes] * (result is not None)), stop=lambda: False)
    assert tested == []
    easy = literal("sequential", "training.min_episodes=15", "ipt.every_episodes=5", "ipt.target_success=1e-9")
    assert easy.run(lambda progress, result: None, stop=lambda: False) == "passed"
    assert easy.progress.episodes == 15


@pytest.mark.parametrize("interval", ["-1", "9.5", "abc"])
def test_a_copy_interval_that_is_no_count_is_one_line(interval):
    with pytest.raises(InputError, match=f"value_network_update_interval: got '?{interval}"):
        literal("sequential", f"target_update.value_network_update_interval={interval}")


def test_a_run_folder_of_version_0_1_says_what_to_do(tmp_path, capsys):
    folder = tmp_path / "run"
    assert run("train", ["experiment=paper/sequential", *LITERAL, "training.max_episodes=20", f"run_dir={folder}"]) == 0
    config = (folder / "config.yaml").read_text().replace("updates: 1", "updates_per_step: 1")
    (folder / "config.yaml").write_text(config)
    assert run("train", [f"resume={folder}"]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "version 0.1" in line
    assert "training.updates" in line
