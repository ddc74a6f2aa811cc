"""Both structures: masked agents never fail, literal ones may; what they store they can decode again."""

from __future__ import annotations

import pytest
import torch
from torchrl.envs.utils import ExplorationType, set_exploration_type

from dore.errors import InputError
from dore.learn import keys
from dore.learn.agents.common import never_empty
from dore.learn.replay import compact, restore
from dore.world.layout import Layout
from dore.world.mirror import mirrored_board
from dore.world.reach import Reach
from dore.world.rules import Failure
from tests.drawings import wide_hand
from tests.worlds import make_agent, make_env

BOTH = pytest.mark.parametrize("kind", ["sequential", "single"])
FORMS = pytest.mark.parametrize("literal", [False, True], ids=["improved", "literal"])


def play(agent, env, steps: int):
    """The steps of a few exploring episodes."""
    shown, taken = env.reset(), []
    with torch.no_grad():
        for _ in range(steps):
            step, shown = env.step_and_maybe_reset(agent.policy(shown))
            taken.append(step)
    return taken


@BOTH
@pytest.mark.parametrize("epsilon", [0.0, 1.0])
def test_masked_agents_never_choose_an_illegal_move(kind, epsilon):
    """On dense boards, greedy and at random: only running out of moves may end an episode badly."""
    reach = wide_hand(3, 6)
    agent, env = make_agent(kind, False, reach, slots=12), make_env(reach, 128, 12, max_moves=12)
    agent.set_epsilon(epsilon)
    failures = torch.cat([step["next", keys.FAILURE] for step in play(agent, env, 20)])
    assert set(failures.tolist()) <= {Failure.NONE, Failure.NO_LEGAL_MOVE}


def test_literal_single_dqn_fails_in_all_ways():
    reach = wide_hand(3, 6)
    agent, env = make_agent("single", True, reach), make_env(reach, 256, 5)
    agent.set_epsilon(1.0)
    failures = {int(code) for step in play(agent, env, 20) for code in step["next", keys.FAILURE]}
    assert failures >= {Failure.PICK, Failure.PLACE, Failure.PICK_AND_PLACE, Failure.GO_BACK}


@BOTH
@FORMS
def test_stored_steps_are_small_and_decode(kind, literal):
    reach = wide_hand(3, 6)
    agent, env = make_agent(kind, literal, reach), make_env(reach, 32, 5)
    (step,) = play(agent, env, 1)
    stored = compact(step, agent.stored, reach.n_cells)
    bytes_each = sum(leaf.numel() * leaf.element_size() for leaf in stored.values(True, True)) / 32
    assert bytes_each <= (28 if kind == "sequential" and literal else 24)
    loss = agent.loss(agent.decode(restore(stored)))
    total = loss["loss_pick"] + loss["loss_place"]
    total.backward()
    assert torch.isfinite(total)
    assert all(parameter.grad is not None for parameter in agent.networks.parameters())


@BOTH
def test_decode_shows_what_the_policy_saw(kind):
    reach = wide_hand(3, 6)
    agent, env = make_agent(kind, False, reach), make_env(reach, 32, 5)
    agent.symmetry = False
    (step,) = play(agent, env, 1)
    decoded = agent.decode(restore(compact(step, agent.stored, reach.n_cells)))
    seen = ("pick", keys.OBSERVATION)
    assert torch.equal(decoded[seen], step[seen])
    action = keys.SLOT if kind == "single" else keys.PICK
    assert torch.equal(decoded[action], step[action])
    if kind == "sequential":
        assert torch.equal(decoded["place", keys.OBSERVATION], step["place", keys.OBSERVATION])


@BOTH
def test_symmetry_shows_each_move_or_its_mirror_image(kind):
    """Every decoded row is the row itself or its mirror image, and both occur."""
    reach = wide_hand(3, 6)
    agent, env = make_agent(kind, False, reach), make_env(reach, 256, 5)
    agent.symmetry = False
    (step,) = play(agent, env, 1)
    stored = restore(compact(step, agent.stored, reach.n_cells))
    plain = agent.decode(stored)
    turned = stored.clone()
    mirror = reach.layout.mirror
    turned[keys.BOARD] = mirrored_board(stored[keys.BOARD], reach)
    turned["next", keys.BOARD] = mirrored_board(stored["next", keys.BOARD], reach)
    for key in (keys.TARGET, keys.PLACE, *((keys.PICK,) if kind == "sequential" else ())):
        turned[key] = mirror[stored[key]]
    mirrored = agent.decode(turned)
    agent.symmetry = True
    mixed = agent.decode(stored)
    seen = ("pick", keys.OBSERVATION)
    is_plain = (mixed[seen] == plain[seen]).flatten(1).all(1) & (mixed[keys.PLACE] == plain[keys.PLACE])
    is_mirrored = (mixed[seen] == mirrored[seen]).flatten(1).all(1) & (mixed[keys.PLACE] == mirrored[keys.PLACE])
    assert (is_plain | is_mirrored).all()
    assert is_plain.any()
    assert is_mirrored.any()
    if kind == "single":
        # The slot moves with its obstacle: the legal slot mask must allow it wherever the stored pick was legal.
        assert mixed[keys.SLOT_MASK].gather(1, mixed[keys.SLOT][:, None]).all()


def test_greedy_is_the_argmax_over_legal_cells():
    reach = wide_hand(3, 6)
    agent, env = make_agent("sequential", False, reach), make_env(reach, 64, 5)
    agent.set_epsilon(1.0)
    shown = env.reset()
    with torch.no_grad(), set_exploration_type(ExplorationType.DETERMINISTIC):
        acted = agent.policy(shown)
    for value, mask, action in (
        (keys.PICK_VALUE, keys.PICK_MASK, keys.PICK),
        (keys.PLACE_VALUE, keys.PLACE_MASK, keys.PLACE),
    ):
        best = acted[value].masked_fill(~acted[mask], -torch.inf).argmax(-1)
        assert torch.equal(acted[action], best)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"gamma": 1.5}, r"agent\.gamma: got 1\.5"),
        ({"mask_mode": "x"}, r"agent\.mask_mode: got 'x', want one of legal, literal"),
        ({"encoding": "x"}, r"agent\.encoding: got 'x', want one of planes, state"),
        ({"loss_function": "l3"}, r"agent\.loss_function: got 'l3'"),
        ({"chain": "x"}, r"agent\.chain: got 'x', want one of natural, literal"),
    ],
)
def test_bad_hyperparameters(change, says):
    from dore.learn.agents.sequential import Sequential
    from tests.worlds import tiny_network

    good = {
        "encoding": "planes",
        "mask_mode": "legal",
        "chain": "natural",
        "gamma": 0.9,
        "double": True,
        "loss_function": "l2",
        "symmetry": True,
    }
    with pytest.raises(InputError, match=says):
        Sequential(wide_hand(3, 3), tiny_network(), **(good | change))


def test_symmetry_needs_a_mirror():
    lopsided = Reach(Layout(((0.5, 0.0), (0.7, 0.2)), 0.1), 0.1, 15.0, 30)
    with pytest.raises(InputError, match="no mirror image"):
        make_agent("sequential", False, lopsided)


def test_rows_that_allow_nothing_allow_everything():
    """Else exploring fails there, or action 0 is chosen without a word."""
    mask = torch.tensor([[False, True, False], [False, False, False]])
    assert never_empty(mask).tolist() == [[False, True, False], [True, True, True]]
