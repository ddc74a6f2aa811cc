"""One learner on several worlds: whose turn it is, what they share, what is kept, and how a stopped run is resumed."""

from __future__ import annotations

import pytest
import torch

from dore.app import session
from dore.app.training import trainer_of
from dore.learn.checkpoint import load_checkpoint, load_model
from dore.learn.evaluator import TestResult, mean_of
from dore.learn.trainer import MAIN, Trainer
from dore.planners.learned import Learned
from dore.world.generator import Difficulty, FreshInstances
from tests.app.test_conf import compose
from tests.commands import run
from tests.drawings import wide_hand
from tests.learn.runs import metrics, same, stopped_and_resumed

SETTINGS = (
    *("instances.validation_size=20", "instances.test_size=20", "env.num_envs=8", "buffer.storage.max_size=300"),
    *("network.width=8", "network.blocks=1", "exploration.anneal_steps=300", "training.batch_size=8"),
    *("training.updates=2", "training.learning_starts=16", "training.max_episodes=150", "training.max_minutes=null"),
    *("ipt.batch_size=20", "ipt.every_episodes=40", "log_every=1", "logger=none"),
)


def small(name: str, rows: int, cols: int) -> list[str]:
    """A further world of a few cells."""
    groups = {"layout": "3x6", "reach": "wide_hand", "instances": "z3-5"}
    values = {"layout.rows": rows, "layout.cols": cols, "instances.min_obstacles": 1, "instances.validation_size": 20}
    given = [f"+{group}@worlds.{name}.{group}={option}" for group, option in groups.items()]
    return given + [f"worlds.{name}.{key}={value}" for key, value in values.items()]


GENERAL = ["agent=sequential", "network=cells", "agent.symmetry=false", *SETTINGS]
THREE = [
    *("layout.rows=3", "layout.cols=3", "instances.min_obstacles=1", "instances.max_obstacles=3", *GENERAL),
    *(*small("wide", 3, 4), *small("deep", 4, 3)),
]


def three(*overrides: str) -> Trainer:
    return trainer_of(compose("train", [*THREE, *overrides]))


def test_the_worlds_take_turns_and_share_one_learner():
    trainer = three("training.averaging=0.9")
    assert list(trainer.worlds) == [MAIN, "wide", "deep"]
    assert [world.env.reach.n_cells for world in trainer.worlds.values()] == [9, 12, 12]
    for turn in range(1, 8):
        before = trainer.learner.agent.networks.state_dict()
        trainer.iterate()
        steps = [world.env_steps // 8 for world in trainer.worlds.values()]
        assert steps == [(turn + 2) // 3, (turn + 1) // 3, turn // 3]
    for world in trainer.worlds.values():
        for part in ("networks", "loss"):
            own, shared = (getattr(agent, part).parameters() for agent in (world.agent, trainer.learner.agent))
            assert all(one is other for one, other in zip(own, shared, strict=True))
    assert trainer.progress.env_steps == 7 * 8
    assert trainer.progress.updates > 0
    assert before.keys() == trainer.learner.averaged.weights().keys()


def test_episodes_of_all_worlds_count_for_the_ipt_and_the_budget(monkeypatch):
    trainer = three("training.update_after=episode", "training.updates=1")
    tested: list[int] = []
    run_test = trainer.run_test
    monkeypatch.setattr(trainer, "run_test", lambda: (tested.append(trainer.progress.episodes), run_test())[1])
    trainer.run(lambda progress, result: None, stop=lambda: False)
    assert tested == [40, 80, 120]
    assert trainer.progress.episodes == 150


def test_each_world_fills_its_own_replay():
    trainer = three("training.fill=20")
    while any(world.filling for world in trainer.worlds.values()):
        trainer.iterate()
    assert trainer.progress.filled == 60
    assert [len(world.buffer) for world in trainer.worlds.values()] == [20, 20, 20]
    assert trainer.progress.episodes == 0


def test_the_mean_over_the_worlds_decides():
    easy = TestResult(success=1.0, passed=True, rearrangements=1.0, cost=1.0)
    hard = TestResult(success=0.0, passed=False, rearrangements=None, cost=16.0)
    mean = mean_of({"easy": easy, "hard": hard})
    assert (mean.success, mean.passed, mean.rearrangements, mean.cost) == (0.5, False, 1.0, 8.5)
    assert mean.by_world == {"easy": easy, "hard": hard}
    assert mean_of({"easy": easy}).passed


def test_the_model_kept_is_that_of_the_lowest_mean_cost(tmp_path, monkeypatch):
    """The first world gets better while the others get worse, and then all get better."""
    costs = iter([(5, 5, 5), (1, 9, 9), (4, 4, 4), (9, 9, 9)])
    kept: list[float] = []

    def tested(self):
        each = zip(self.worlds, next(costs), strict=True)
        return mean_of({name: TestResult(0.5, False, 1.0, float(cost)) for name, cost in each})

    save = session.Session._save_model
    monkeypatch.setattr(Trainer, "run_test", tested)
    monkeypatch.setattr(
        session.Session,
        "_save_model",
        lambda self, *given: (kept.append(self.trainer.progress.best_cost), save(self, *given)),
    )
    assert run("train", [*THREE, f"run_dir={tmp_path / 'run'}"]) == 0
    assert kept == [5.0, 4.0]


def test_the_learning_rate_falls_over_the_budget():
    trainer = three("training.lr_end=0.1", "optimizer.lr=0.01", "training.max_episodes=200")
    (group,) = trainer.learner.optimizer.param_groups
    rates = []
    for episodes in (0, 100, 200):
        trainer.progress.episodes = episodes
        trainer.learner.set_rate(trainer._share_spent())
        rates.append(group["lr"])
    assert rates == pytest.approx([0.01, 0.0055, 0.001])
    trainer = three("training.lr_end=0.1", "optimizer.lr=0.01")
    while trainer.progress.episodes < 100:
        trainer.iterate()
    assert trainer.learner.optimizer.param_groups[0]["lr"] < 0.01, "the loop sets it"


@pytest.mark.slow
def test_the_generalist_stops_and_resumes_as_if_it_had_not(tmp_path):
    """The shipped experiment on all of its worlds, with small sets: bit for bit, and loadable as what ships is."""
    few = [f"worlds.{name}.instances.validation_size=20" for name in compose("train", ["experiment=generalist"]).worlds]
    common = ["experiment=generalist", *SETTINGS, *few, "training.max_episodes=300"]
    whole, parts = stopped_and_resumed(tmp_path, common, iteration=17)
    assert len(whole["worlds"]) == len(few) + 1
    assert same(whole, parts)
    rows = metrics(tmp_path / "whole")
    assert rows == metrics(tmp_path / "parts")
    last = [row for row in rows if row["success"]][-1]
    each = [float(value) for name, value in last.items() if name.startswith("success_")]
    assert len(each) == len(few) + 1
    assert float(last["success"]) == pytest.approx(sum(each) / len(each))
    assert same(load_model(tmp_path / "whole"), load_model(tmp_path / "parts"))
    reach = wide_hand(5, 4)
    plans = Learned(reach, tmp_path / "whole", 16).plan(FreshInstances(reach, Difficulty(2, 5), "test", 0).draw(5))
    assert len(plans) == 5


@pytest.mark.parametrize("iteration", [1, 31])
def test_a_stopped_run_on_three_worlds_resumes_as_if_it_had_not(tmp_path, iteration):
    common = [*THREE, "training.update_after=episode", "training.fill=20", "training.lr_end=0.1"]
    whole, parts = stopped_and_resumed(tmp_path, common, iteration)
    assert same(whole, parts)
    assert metrics(tmp_path / "whole") == metrics(tmp_path / "parts")


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (["network=mlp"], "worlds: this network serves one layout"),
        (["worlds.wide.layout.rows=0"], "worlds.wide: layout"),
        (["+worlds.odd.layout.rows=3"], "worlds.odd: got layout, want layout, reach, instances"),
        (["+worlds.odd=3"], "worlds.odd: got 3, want layout, reach, instances"),
        (["worlds.wide.instances.max_obstacles=50"], "worlds.wide: instances.max_obstacles: 50 obstacles"),
        (small(MAIN, 3, 3), "worlds.main: main is the name of the world that layout, reach and instances give"),
        (["training.lr_end=0"], "training.lr_end: got 0, want a finite number above 0 and at most 1"),
    ],
)
def test_bad_worlds_are_one_line(tmp_path, capsys, more, says):
    given = [one for one in THREE if not ("network=mlp" in more and one.startswith("network"))]
    assert run("train", [*given, *more, f"run_dir={tmp_path / 'run'}"]) == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("dore-train")]
    assert says in line
    assert not (tmp_path / "run").exists()


def test_a_run_is_of_the_worlds_that_it_was_started_with(tmp_path, capsys):
    arguments = [*THREE, f"run_dir={tmp_path / 'run'}", "existing=continue"]
    assert run("train", arguments) == 0
    assert run("train", arguments) == 0
    assert "finished already" in capsys.readouterr().out
    assert run("train", [*arguments, "worlds.wide.layout.cols=5"]) == 2
    assert "was started with worlds.wide.layout.cols=4, not 5" in capsys.readouterr().err
    assert run("train", [*arguments, *small("more", 3, 3)]) == 2
    assert "was started with worlds.more." in capsys.readouterr().err


@pytest.mark.slow
def test_a_checkpoint_from_before_there_were_worlds_resumes(tmp_path):
    """Its parts lay side by side; it resumes bit for bit."""
    one = [*GENERAL, "layout.rows=3", "layout.cols=4", "training.max_episodes=70"]
    for name in ("new", "old"):
        assert run("train", [*one, f"run_dir={tmp_path / name}"]) == 0
    path = tmp_path / "old" / "checkpoint.pt"
    state = load_checkpoint(path)
    world = state.pop("worlds")[MAIN]
    learner = state.pop("learner")
    world = {key: value for key, value in world.items() if key not in ("filled", "env_steps", "steps")}
    torch.save({**state, **world, **learner}, path)
    for name in ("new", "old"):
        assert run("train", [f"resume={tmp_path / name}", "training.max_episodes=150"]) == 0
    assert same(*(load_checkpoint(tmp_path / name / "checkpoint.pt") for name in ("new", "old")))
