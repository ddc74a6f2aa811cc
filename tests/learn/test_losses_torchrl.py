"""The losses by TorchRL's conventions: its own DQNLoss where they coincide, keys, dispatch, priorities, weights."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule, TensorDictSequential
from torch import Tensor, nn
from torchrl.data import Categorical
from torchrl.modules import QValueModule
from torchrl.objectives import DQNLoss, SoftUpdate, ValueEstimators

from dore.learn import keys
from dore.learn.losses import SequentialLoss, SingleLoss
from dore.learn.q_loss import QLoss

B, SEEN, CELLS, GAMMA = 64, 5, 4, 0.7
PICK_SEEN, PLACE_SEEN = ("pick", keys.OBSERVATION), ("place", keys.OBSERVATION)
DOUBLE = pytest.mark.parametrize("double", [False, True])


class Heads(nn.Module):
    """Linear heads on one observation."""

    def __init__(self, n: int) -> None:
        super().__init__()
        self.heads = nn.ModuleList(nn.Linear(SEEN, CELLS) for _ in range(n))

    def forward(self, seen: Tensor) -> tuple[Tensor, ...]:
        return tuple(head(seen) for head in self.heads)


def sequential(double: bool = False, chain: str = "literal", failed_pick: str = "punish", **more) -> SequentialLoss:
    """Of linear networks, whose targets differ from them."""
    torch.manual_seed(0)
    pick = TensorDictModule(Heads(1), in_keys=[PICK_SEEN], out_keys=[keys.PICK_VALUE])
    place = TensorDictModule(Heads(1), in_keys=[PLACE_SEEN], out_keys=[keys.PLACE_VALUE])
    return moved(SequentialLoss(pick, place, GAMMA, double, "legal", chain, failed_pick, "l2", **more))


def single(double: bool = False, **more) -> SingleLoss:
    torch.manual_seed(0)
    network = TensorDictModule(Heads(2), in_keys=[PICK_SEEN], out_keys=[keys.SLOT_VALUE, keys.PLACE_VALUE])
    return moved(SingleLoss(network, GAMMA, double, "legal", "independent", "l2", **more))


def moved(loss: QLoss) -> QLoss:
    """With target networks that are not the online ones."""
    SoftUpdate(loss, tau=0.5)
    with torch.no_grad():
        for name, value in loss.state_dict().items():
            if name.startswith("target_"):
                value.normal_()
    return loss


def batch() -> TensorDict:
    """Random transitions with every key that either loss reads."""
    torch.manual_seed(1)

    def entry() -> dict[str, Tensor]:
        mask = torch.rand(B, CELLS) < 0.5
        mask[:, 0] = True
        slots = mask.roll(1, -1)
        action, slot = torch.randint(CELLS, (B,)), torch.randint(CELLS, (B,))
        seen, reward = torch.randn(B, SEEN), torch.randn(B, 1)
        return {"observation": seen, "mask": mask, "slot_mask": slots, "action": action, "slot": slot, "reward": reward}

    def board() -> dict[str, object]:
        return {"pick": entry(), "place": entry(), keys.TERMINATED: torch.rand(B, 1) < 0.3}

    return TensorDict(
        {**board(), keys.PICKED: torch.rand(B) < 0.8, "next": board(), keys.LIFTED: board()}, batch_size=[B]
    )


def stock(network: nn.Module, target: dict[str, Tensor], double: bool) -> DQNLoss:
    """TorchRL's loss of one head."""
    head = TensorDictSequential(
        TensorDictModule(network, in_keys=["seen"], out_keys=["action_value"]),
        QValueModule(spec=Categorical(CELLS), action_value_key="action_value", action_mask_key="mask"),
    )
    loss = DQNLoss(head, loss_function="l2", delay_value=True, double_dqn=double, action_space="categorical")
    loss.make_value_estimator(ValueEstimators.TD0, gamma=GAMMA)
    SoftUpdate(loss, tau=0.5)
    with torch.no_grad():
        for name, value in loss.state_dict().items():
            if name.startswith("target_"):
                value.copy_(target[name.rsplit(".", 1)[-1]])
    return loss


def for_stock(td: TensorDict, after: TensorDict, head: str, slot: bool, reward: Tensor, ends: Tensor) -> TensorDict:
    """One head's part of a batch, under TorchRL's names; `single` sees the pick's observation with both heads."""
    seen, mask = ("pick" if slot else head, keys.OBSERVATION), "slot_mask" if slot and head == "pick" else "mask"
    action = "slot" if slot and head == "pick" else "action"
    following = {"seen": after[seen], "mask": after[head, mask], "reward": reward, "terminated": ends, "done": ends}
    now = {"seen": td[seen], "mask": torch.ones(B, CELLS, dtype=torch.bool), "action": td[head, action]}
    return TensorDict({**now, "next": TensorDict(following, batch_size=[B])}, batch_size=[B])


@DOUBLE
@pytest.mark.parametrize("kind", ["sequential", "single"])
@pytest.mark.parametrize("head", ["pick", "place"])
def test_each_head_is_torchrls_own_loss(kind, head, double):
    """chain=literal and heads=independent: values and gradients."""
    ours, td = (sequential if kind == "sequential" else single)(double), batch()
    index = 0 if kind == "sequential" or head == "pick" else 1
    name = head if kind == "sequential" else "network"
    network, prefix = ours._online[name].module.heads[index], f"target_{name}_params.module.heads.{index}."
    if kind == "sequential":
        after = td[keys.LIFTED] if head == "pick" else td["next"]
        given = for_stock(td, after, head, False, td["next", head, "reward"], after[keys.TERMINATED])
    else:
        given = for_stock(td, td["next"], head, True, td["next", "place", "reward"], td["next", keys.TERMINATED])
    target = {key.rsplit(".", 1)[-1]: value for key, value in ours.state_dict().items() if key.startswith(prefix)}
    theirs = stock(network, target, double)
    values, gradients = [], []
    for loss in (ours(td)[f"loss_{head}"], theirs(given)["loss"]):
        network.zero_grad()
        loss.backward()
        values.append(loss.detach())
        gradients.append([parameter.grad.clone() for parameter in network.parameters()])
    torch.testing.assert_close(values[0], values[1])
    torch.testing.assert_close(gradients[0], gradients[1])
    assert len(gradients[0]) == 2
    assert all(bool(gradient.any()) for gradient in gradients[0])


@pytest.mark.parametrize("make", [sequential, single])
def test_double_q_learning_changes_the_targets(make):
    """The online network chooses, the target network values."""
    plain, double = make(False)(batch()), make(True)(batch())
    for name in ("loss_pick", "loss_place"):
        assert plain[name] != double[name], name


@DOUBLE
def test_the_natural_chain_lets_the_online_place_network_choose_where_it_is_double(double):
    loss, td = sequential(double, chain="natural"), batch()
    target = loss._run_target("place", td)[keys.PLACE_VALUE]
    chooser = loss._run("place", td)[keys.PLACE_VALUE] if double else target
    legal = chooser.masked_fill(~td[keys.PLACE_MASK], -torch.inf)
    best = target.gather(-1, legal.argmax(-1, keepdim=True))
    value = loss._run("pick", td)[keys.PICK_VALUE].gather(-1, td[keys.PICK][:, None])
    torch.testing.assert_close(loss(td)["loss_pick"], (value - best).square().mean())


@pytest.mark.parametrize("make", [sequential, single])
def test_it_reads_its_in_keys_and_no_others_and_dispatches_on_them(make):
    loss, td = make(), batch()
    alone = td.select(*loss.in_keys)
    expected = loss(td)
    assert loss.out_keys == ["loss_pick", "loss_place"]
    torch.testing.assert_close(loss(alone), expected)
    named = {"_".join((key,) if isinstance(key, str) else key): td[key] for key in loss.in_keys}
    torch.testing.assert_close(loss(**named), (expected["loss_pick"], expected["loss_place"]))
    for key in loss.in_keys:
        with pytest.raises(KeyError):
            loss(td.exclude(key))


def test_keys_can_be_renamed():
    loss, td = sequential(), batch()
    expected = loss(td.clone())
    loss.set_keys(place_reward="money", terminated=("flags", "over"), priority="surprise")
    td["next", "money"] = td["next"].pop(keys.PLACE_REWARD)
    for part in ("next", keys.LIFTED):
        td[part, "flags", "over"] = td[part].pop(keys.TERMINATED)
    torch.testing.assert_close(loss(td), expected)
    assert "surprise" in td
    with pytest.raises(ValueError, match="not an accepted tensordict key"):
        loss.set_keys(colour="red")


@pytest.mark.parametrize(("make", "skip"), [(sequential, False), (sequential, True), (single, False)])
def test_priorities_are_the_squared_errors_of_both_heads(make, skip):
    loss = make(failed_pick="skip") if skip else make()
    td = batch()
    losses = loss(td)
    assert td["td_error"].shape == (B, 1)
    placed = td[keys.PICKED] if skip else torch.ones(B, dtype=torch.bool)
    alone = make(failed_pick="skip", reduction="none") if skip else make(reduction="none")
    each = alone(batch())
    expected = each["loss_pick"].clone()
    expected[placed] += each["loss_place"]
    torch.testing.assert_close(td["td_error"].squeeze(-1), expected)
    torch.testing.assert_close(losses["loss_pick"], each["loss_pick"].mean())


def test_importance_weights_and_sums():
    td, weight = batch(), torch.rand(B)
    each = single(reduction="none")(td)["loss_pick"]
    torch.testing.assert_close(single(reduction="sum")(td)["loss_pick"], each.sum())
    td["priority_weight"] = weight
    weighted = single()(td)["loss_pick"]
    torch.testing.assert_close(weighted, (each * weight).sum() / weight.sum())


def test_only_one_step_targets():
    loss = sequential(chain="natural")
    before = loss(batch())["loss_place"]
    assert loss.make_value_estimator(ValueEstimators.TD0, gamma=0.1).gamma == 0.1
    assert loss(batch())["loss_place"] != before
    with pytest.raises(NotImplementedError, match="want TD0"):
        loss.make_value_estimator(ValueEstimators.TDLambda)
    with pytest.raises(TypeError, match="lmbda is not gamma"):
        loss.make_value_estimator(lmbda=0.9)
