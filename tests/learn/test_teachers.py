"""Teachers: labels of what is played, optimal moves shown, and the losses that learn from them."""

from functools import partial

import pytest
import torch
from tensordict import TensorDict

from dore.errors import InputError
from dore.learn import keys
from dore.learn.checkpoint import load_model
from dore.learn.teachers.demonstrations import OPTIMAL, Demonstrations
from dore.learn.teachers.exact import LABELLED, LABELS, Lessons
from dore.learn.teachers.imitation import LABELLED_CHOICE, WASTED, Imitation
from dore.learn.teachers.packing import packed, unpacked
from dore.world.board import pack
from dore.world.generator import SPLITS, split_share
from dore.world.labeller import Labeller
from dore.world.layout import Layout
from dore.world.problem import Batch
from dore.world.reach import Reach
from tests.commands import TINY, run
from tests.learn.runs import metrics, same, stopped_and_resumed
from tests.worlds import make_agent, make_env

REACH = Reach(Layout.grid(3, 4, 0.12, None), clearance_m=0.19, half_fan_deg=20.0, n_sectors=40)
EXACT = {"max_nodes": 10**5, "max_moves": 40, "enough": 10**7}
imitation = partial(Imitation, reach=REACH, waste=0.5, **EXACT)
demonstrations = partial(Demonstrations, reach=REACH, margin=0.8, weight=2.0, **EXACT)


def test_labels_survive_packing():
    wasted = torch.randint(-2, 3, (7, 5, 5), dtype=torch.int8)
    assert torch.equal(unpacked(packed(wasted), 5), wasted.clamp_min(-1))


def taught_step(optimal: float):
    """An environment's observation, and the step that a policy makes of it with a teacher who shows that share."""
    env = make_env(REACH, 200, most=7, least=5)
    agent = make_agent("sequential", False, REACH)
    agent.set_epsilon(0.0)
    observed = env.reset()
    return env, observed, imitation(optimal=optimal).act(observed.clone(), agent.policy), agent


def test_a_teacher_that_shows_all_moves_plays_shortest_plans():
    env, observed, step, _ = taught_step(1.0)
    before = Labeller(REACH, 10**5, 40).fewest(Batch(observed[keys.BOARD], observed[keys.TARGET]))
    after = env.step(step)["next"]
    left = Labeller(REACH, 10**5, 40).fewest(Batch(after[keys.BOARD], after[keys.TARGET]))
    labelled = step[LABELLED]
    assert int(labelled.sum()) > 50
    assert torch.equal(left[labelled], before[labelled] - 1)


def test_a_teacher_that_shows_none_leaves_the_policy_alone():
    _, observed, step, agent = taught_step(0.0)
    assert torch.equal(step[keys.PICK], agent.policy(observed)[keys.PICK])


def test_no_board_of_the_test_split_gets_a_label():
    _, observed, step, _ = taught_step(0.5)
    board, target = observed[keys.BOARD], observed[keys.TARGET]
    of_test = split_share(board, REACH) >= SPLITS["test"][0]
    env = make_env(REACH, 200, most=7, least=5)
    env.source = type(env.source)(REACH, env.source.difficulty, "test", 0)
    shown = imitation(optimal=0.5).act(env.reset(), make_agent("sequential", False, REACH).policy)
    assert not bool(of_test.any())
    assert bool(step[LABELLED].any())
    assert not bool(shown[LABELLED].any())
    wasted = unpacked(step[LABELS], REACH.n_cells)
    expected = Labeller(REACH, 10**5, 40).label(Batch(board, target)).wasted
    assert torch.equal(wasted, expected.clamp_min(-1))


def test_what_is_stored_is_decoded_to_the_labels_of_the_board_or_of_its_mirror_image():
    _, _, step, agent = taught_step(0.5)
    teacher = imitation(optimal=0.5)
    step = step.update({"next": TensorDict({keys.BOARD: step[keys.BOARD]}, batch_size=step.batch_size)})
    step["next", keys.TERMINATED] = torch.zeros(len(step), 1, dtype=torch.bool)
    step["next", *keys.PLACE_REWARD] = torch.zeros(len(step), 1)
    rows = teacher.kept(step, agent)
    assert len(rows) == int(step[LABELLED].sum())
    rows[keys.TARGET] = rows[keys.TARGET].long()
    decoded = teacher.decode(rows, agent)
    labeller = Labeller(REACH, 10**5, 40)
    planes = decoded["pick", keys.OBSERVATION]
    board, target = pack(planes[:, 0].bool()), planes[:, 1].argmax(-1)
    assert not torch.equal(board, rows[keys.BOARD])  # Some are mirrored.
    wasted = labeller.label(Batch(board, target)).wasted
    for_pick = torch.where(wasted >= 0, wasted, 9).amin(-1)
    labelled = decoded["pick", LABELLED_CHOICE]
    assert torch.equal(labelled, (wasted >= 0).any(-1))
    assert torch.equal(decoded["pick", WASTED][labelled], for_pick[labelled].float())
    lifted = planes[:, 0] - decoded["place", keys.OBSERVATION][:, 0]
    assert bool((lifted.sum(-1) == 1).all())
    of_place = wasted[torch.arange(len(wasted)), lifted.argmax(-1)]
    assert torch.equal(decoded["place", LABELLED_CHOICE], of_place >= 0)


def test_the_imitation_loss_is_that_of_its_definition():
    labels = TensorDict(
        {WASTED: torch.tensor([[1.0, 1.0, 2.0, 0.0]]), LABELLED_CHOICE: torch.tensor([[True, True, True, False]])},
        batch_size=1,
    )
    values = torch.tensor([[0.3, -0.2, 1.0, 5.0]], requires_grad=True)
    chance = values[:, :3].softmax(-1)[0]
    expected = -(chance[0] + chance[1]).log() + 0.5 * chance[2]
    loss = imitation(optimal=0.0)._loss(values, labels)
    torch.testing.assert_close(loss, expected)
    loss.backward()
    assert values.grad[0, 3] == 0
    assert values.grad[0, 2] > 0
    assert values.grad[0, 0] < 0


def test_the_margin_is_zero_only_where_an_optimal_choice_leads_by_it():
    labels = TensorDict(
        {
            "mask": torch.ones(3, 3, dtype=torch.bool),
            OPTIMAL: torch.tensor([[True, True, False], [True, False, False], [False, False, False]]),
        },
        batch_size=3,
    )
    values = torch.tensor([[0.0, 2.0, 1.0], [1.0, 1.5, 0.0], [0.0, 9.0, 0.0]])
    # Led by 1.0; behind by 0.5, so 0.5 + 0.8; nothing is known.
    torch.testing.assert_close(demonstrations(optimal=0.0)._margin(values, labels), torch.tensor(1.3 / 3))


TAUGHT = [*TINY, "instances=dense", "instances.validation_size=20", "instances.test_size=20", "ipt.batch_size=20"]
TAUGHT = [option for option in TAUGHT if "obstacles" not in option and "instances.train_size" not in option]


@pytest.mark.parametrize("teacher", [["teacher=imitation"], ["teacher=demonstrations", "agent.symmetry=false"]])
def test_taught_runs_resume_as_if_they_had_not_stopped(tmp_path, teacher):
    common = [*TAUGHT, *teacher, "training.max_episodes=60", "ipt.every_episodes=30"]
    whole, parts = stopped_and_resumed(tmp_path, common, iteration=9)
    assert same(whole, parts)
    assert metrics(tmp_path / "whole") == metrics(tmp_path / "parts")
    assert same(load_model(tmp_path / "whole"), load_model(tmp_path / "parts"))


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (["teacher=imitation", "agent=single", "agent.n_slots=5"], "teacher: teaches agent=sequential, got single"),
        (["teacher=imitation", "training.update_after=episode"], "training.update_after: got episode, want round"),
        (["teacher=demonstrations"], "agent.symmetry: got true, want false with teacher=demonstrations"),
        (["teacher=imitation", "teacher.optimal=2"], "teacher.optimal: got 2"),
        (["teacher=imitation", "teacher.max_nodes=0"], "teacher.max_nodes: got 0"),
    ],
)
def test_what_cannot_be_taught_is_refused_before_anything_is_written(tmp_path, capsys, options, line):
    assert run("train", [*TAUGHT, *options, f"run_dir={tmp_path / 'run'}"]) == 2
    assert line in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_lessons_want_the_separated_agent():
    with pytest.raises(InputError, match="teaches agent=sequential"):
        Lessons(imitation(optimal=0.5), make_agent("single", False, REACH))
