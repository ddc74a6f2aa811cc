"""One agent on every layout, and the model that ships."""

from __future__ import annotations

from functools import partial

import pytest
import torch

from dore.errors import InputError
from dore.learn.agents.sequential import Sequential
from dore.learn.networks import CellNet
from dore.learn.rollout import greedy_rollout
from dore.planners.learned import Learned
from dore.world.generator import Difficulty, FreshInstances
from dore.world.rules import accessibility
from tests.drawings import wide_hand
from tests.worlds import make_agent


def cells_agent(rows: int, cols: int) -> Sequential:
    torch.manual_seed(0)
    return Sequential(
        reach=wide_hand(rows, cols),
        network=partial(CellNet, width=8, blocks=1),
        encoding="lanes",
        mask_mode="legal",
        chain="natural",
        gamma=0.8,
        double=True,
        loss_function="smooth_l1",
        symmetry=False,
    )


def test_an_agent_on_another_layout_is_the_one_made_for_it():
    reach = wide_hand(4, 6)
    moved, made = cells_agent(3, 5).on(reach), cells_agent(4, 6)
    batch = FreshInstances(reach, Difficulty(3, 9), "train", 0).draw(50)
    first, second = (greedy_rollout(agent.greedy, reach, batch, 8) for agent in (moved, made))
    assert torch.equal(first.pick, second.pick)
    assert torch.equal(first.place, second.place)
    assert moved.loss.state_dict().keys() == made.loss.state_dict().keys()


def test_it_shares_weights_and_loss():
    agent = cells_agent(3, 5)
    other = agent.on(wide_hand(4, 6))
    for one, same in ((agent.networks, other.networks), (agent.loss, other.loss)):
        assert all(a is b for a, b in zip(one.parameters(), same.parameters(), strict=True))
    assert other.reach.n_cells == 24
    assert agent.reach.n_cells == 15


@pytest.mark.parametrize("kind", ["sequential", "single"])
def test_the_greedy_place_is_the_most_valued_one(kind):
    reach = wide_hand(4, 5)
    agent = make_agent(kind, False, reach, slots=8)
    batch = FreshInstances(reach, Difficulty(3, 8), "train", 0).draw(40)
    played = greedy_rollout(agent.greedy, reach, batch, 1)
    moved = played.n_moves == 1
    board, target, pick = batch.board[moved], batch.target[moved], played.pick[moved, 0]
    values = agent.move_values(board, target, pick)
    lifted = board & ~(torch.ones_like(pick) << pick)[:, None]
    open_ = accessibility(reach, lifted, target).place.scatter(1, pick[:, None], False)
    assert torch.equal(values.masked_fill(~open_, -torch.inf).argmax(-1), played.place[moved, 0])


def test_a_head_that_is_not_of_cells_is_refused():
    with pytest.raises(InputError, match="one output a cell"):
        CellNet(wide_hand(3, 3), n_planes=3, n_outputs=(5, 9), width=8, blocks=1)


def test_the_shipped_model_serves_a_layout_it_never_saw():
    reach = wide_hand(5, 7)
    batch = FreshInstances(reach, Difficulty(3, 8), "test", 0).draw(100)
    plans = Learned(reach, None, 16).plan(batch)
    assert sum(plan.status == "solved" for plan in plans) >= 95
