"""Temporal-difference targets on hand-made values, in both forms, and masked choices."""

from __future__ import annotations

import math

import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import nn

from dore.learn import keys
from dore.learn.losses import SequentialLoss, SingleLoss
from dore.learn.q_loss import best_value, masked

OBSERVED_PICK, OBSERVED_PLACE = ("pick", keys.OBSERVATION), ("place", keys.OBSERVATION)


class Scale(nn.Module):
    """Q-values = the observation times a weight."""

    def __init__(self, weight: float, heads: int = 1) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.tensor(weight))
        self.heads = heads

    def forward(self, x):
        return (x * self.weight,) * self.heads


def test_masked_choices():
    values, mask = torch.tensor([[-1.0, -5.0, 3.0]]), torch.tensor([[True, True, False]])
    assert masked(values, mask, "legal").argmax() == 0
    assert masked(values, mask, "literal").argmax() == 2, "Q x 0 beats legal negative values"


def test_best_value():
    values = torch.tensor([[1.0, 2.0, 9.0], [1.0, 2.0, 9.0]])
    mask = torch.tensor([[True, True, False], [False, False, False]])
    assert best_value(values, values, mask, "legal").squeeze(-1).tolist() == [2.0, 0.0]
    online = torch.tensor([[5.0, 1.0, 0.0]])
    assert best_value(values[:1], online, mask[:1], "legal").item() == 1.0, "double: online chooses, target values"
    low = torch.tensor([[-3.0, -4.0, -1.0]])
    assert best_value(low, low, mask[:1], "literal").item() == 0.0


def sequential(chain: str, double: bool = False, failed_pick: str = "skip") -> SequentialLoss:
    pick = TensorDictModule(Scale(1.0), in_keys=[OBSERVED_PICK], out_keys=[keys.PICK_VALUE])
    place = TensorDictModule(Scale(1.0), in_keys=[OBSERVED_PLACE], out_keys=[keys.PLACE_VALUE])
    return SequentialLoss(pick, place, 0.5, double, "legal", chain, failed_pick, "l2")


def entry(pick=None, place=None, **more) -> TensorDict:
    td = TensorDict({}, batch_size=[1])
    for head, values in (("pick", pick), ("place", place)):
        if values is not None:
            td[head, keys.OBSERVATION] = torch.tensor([values])
            td[head, "mask"] = torch.tensor([[True, True, False]])
    for key, value in more.items():
        td[key] = value
    return td


def transition(terminated: bool, picked: bool = True) -> TensorDict:
    after = entry(pick=[3.0, 1.0, 9.0], place=[5.0, 4.0, 9.0])
    after[keys.TERMINATED] = torch.tensor([[terminated]])
    after[keys.PLACE_REWARD], after[keys.PICK_REWARD] = torch.tensor([[7.0]]), torch.tensor([[0.25]])
    td = entry(pick=[2.0, 0.5, 9.0], place=[1.0, 6.0, 9.0], next=after)
    td[keys.PICK], td[keys.PLACE], td[keys.PICKED] = torch.tensor([1]), torch.tensor([0]), torch.tensor([picked])
    td["lifted"] = entry(pick=[8.0, 0.0, 9.0])
    td["lifted", keys.TERMINATED] = torch.tensor([[False]])
    return td


@pytest.mark.parametrize("terminated", [False, True])
def test_natural_chain(terminated):
    """Q_p(s, p) <- max Q_l(s_l, .) = 6; Q_l(s_l, l) <- 7 + 0.5 max Q_p(s', .) = 8.5, or 7 at the end."""
    loss = sequential("natural")(transition(terminated))
    assert loss["loss_pick"].item() == pytest.approx((0.5 - 6.0) ** 2)
    assert loss["loss_place"].item() == pytest.approx((1.0 - (7.0 if terminated else 8.5)) ** 2)


def test_literal_chain():
    """Each network bootstraps on its own next state: 0.25 + 0.5 x 8 for the pick, 7 + 0.5 x 5 for the place."""
    loss = sequential("literal")(transition(terminated=False))
    assert loss["loss_pick"].item() == pytest.approx((0.5 - 4.25) ** 2)
    assert loss["loss_place"].item() == pytest.approx((1.0 - 9.5) ** 2)


def test_double_q_learning_lets_the_online_network_choose_and_the_target_network_value():
    """Online values are -1 times the observations and so choose what the targets, the observations, value least."""
    loss = sequential("natural", double=True)
    for parameters in (loss.pick_params, loss.place_params):
        next(iter(parameters.parameters())).data.fill_(-1.0)
    losses = loss(transition(terminated=False))
    assert losses["loss_pick"].item() == pytest.approx((-0.5 - 1.0) ** 2), "1, not 6, of the places after the lift"
    assert losses["loss_place"].item() == pytest.approx((-1.0 - (7.0 + 0.5 * 1.0)) ** 2), "1, not 3, of the next picks"


@pytest.mark.parametrize("chain", ["natural", "literal"])
def test_the_place_network_learns_nothing_from_a_failed_pick(chain):
    """Nothing was lifted: only the pick network learns, r_n = 7 here, or its own reward in the literal chain."""
    failed = transition(terminated=True, picked=False)
    failed["lifted", keys.TERMINATED] = torch.tensor([[True]])
    loss = sequential(chain)(failed.clone())
    assert loss["loss_place"].item() == 0.0
    assert loss["loss_pick"].item() == pytest.approx((0.5 - (7.0 if chain == "natural" else 0.25)) ** 2)
    both = torch.cat([failed, transition(terminated=True)])
    alone = sequential(chain)(transition(terminated=True))["loss_place"]
    assert sequential(chain)(both)["loss_place"].item() == pytest.approx(alone.item()), "the mean is over real places"
    punished = sequential(chain, failed_pick="punish")(failed)
    assert punished["loss_place"].item() == pytest.approx((1.0 - 7.0) ** 2)


@pytest.mark.parametrize("chain", ["natural", "literal"])
def test_targets_worked_out_ahead_give_the_same_loss(chain):
    loss, td = sequential(chain), torch.cat([transition(False), transition(True), transition(True, picked=False)])
    at_once, ahead = loss(td), loss(loss.with_targets(td))
    assert {name: value.item() for name, value in at_once.items()} == {n: v.item() for n, v in ahead.items()}


def single(heads: str) -> SingleLoss:
    network = TensorDictModule(Scale(1.0, 2), in_keys=[OBSERVED_PICK], out_keys=[keys.SLOT_VALUE, keys.PLACE_VALUE])
    return SingleLoss(network, 0.5, False, "legal", heads, "l2")


@pytest.mark.parametrize(
    ("heads", "terminated", "pick", "place"),
    [("independent", False, 8.5, 7.5), ("mean", False, 8.0, 8.0), ("independent", True, 7.0, 7.0)],
)
def test_single_heads(heads, terminated, pick, place):
    after = TensorDict({"pick": {keys.OBSERVATION: torch.tensor([[3.0, 1.0, 9.0]])}, "place": {}}, batch_size=[1])
    after[keys.SLOT_MASK] = torch.tensor([[True, True, False]])
    after[keys.PLACE_MASK] = torch.tensor([[False, True, False]])
    after[keys.PLACE_REWARD], after[keys.TERMINATED] = torch.tensor([[7.0]]), torch.tensor([[terminated]])
    td = TensorDict({"pick": {keys.OBSERVATION: torch.tensor([[2.0, 0.5, 9.0]])}, "next": after}, batch_size=[1])
    td[keys.SLOT], td[keys.PLACE] = torch.tensor([0]), torch.tensor([1])
    loss = single(heads)(td)
    assert loss["loss_pick"].item() == pytest.approx((2.0 - pick) ** 2)
    assert loss["loss_place"].item() == pytest.approx((0.5 - place) ** 2)


def test_targets_do_not_move_with_the_online_network():
    loss, td = sequential("natural"), transition(terminated=False)
    with torch.no_grad():
        next(iter(loss.pick_params.parameters())).fill_(100.0)
    assert loss(td)["loss_place"].item() == pytest.approx((1.0 - 8.5) ** 2)


def test_empty_masks_give_a_finite_loss():
    td = transition(terminated=False)
    td["next", "pick", "mask"] = torch.zeros(1, 3, dtype=torch.bool)
    assert all(math.isfinite(value.item()) for value in sequential("natural", double=True)(td).values())
