"""The learner's updates and the evaluator's cost: rules that decide what is learned and what is kept."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict

from dore.learn.budget import Budget
from dore.learn.evaluator import PerformanceTest
from dore.learn.learner import DECODED_AT_ONCE, Learner
from dore.world.generator import Difficulty
from dore.world.instances import InstanceSet
from tests.drawings import wide_hand
from tests.worlds import make_agent


def learner(max_grad_norm: float | None) -> Learner:
    budget = Budget(
        min_episodes=0,
        max_episodes=1,
        max_minutes=None,
        fill=0,
        learning_starts=1,
        batch_size=4,
        update_after="round",
        updates=1,
        keep="best",
        max_grad_norm=max_grad_norm,
        averaging=None,
        precision="float32",
    )
    agent = make_agent("sequential", False, wide_hand(3, 4))
    optimizer = torch.optim.SGD(agent.networks.parameters(), lr=1.0)
    return Learner(agent, optimizer, _Targets(), budget)  # type: ignore[arg-type]


class _Targets:
    """Target networks that stay as they are."""

    def step(self) -> None:
        pass


def step_length(max_grad_norm: float | None, monkeypatch: pytest.MonkeyPatch) -> float:
    """How far one update of plain gradient descent at rate 1 moves the weights: the norm of the gradient."""
    made = learner(max_grad_norm)
    weights = list(made.agent.networks.parameters())
    before = [weight.detach().clone() for weight in weights]

    def steep(batch: object) -> dict[str, torch.Tensor]:
        return {"loss_pick": sum(100 * weight.sum() for weight in weights), "loss_place": torch.zeros(())}

    monkeypatch.setattr(type(made.agent.loss), "forward", lambda self, batch: steep(batch))
    made.update(None, made.agent)  # type: ignore[arg-type]
    moved = [(new - old).square().sum() for new, old in zip(weights, before, strict=True)]
    return float(torch.stack(moved).sum().sqrt().detach())


def test_gradients_are_scaled_down_to_their_largest_norm(monkeypatch):
    assert step_length(2.0, monkeypatch) == pytest.approx(2.0, rel=1e-3)
    assert step_length(None, monkeypatch) > 100


def test_a_large_sample_is_decoded_in_parts_and_learned_whole():
    made = learner(None)
    sizes: list[int] = []
    made.update = lambda batch, agent: (sizes.append(len(batch)), torch.zeros(()))[1]  # type: ignore[method-assign]
    made.agent.loss.double = True
    decoded: list[int] = []
    n = 2 * DECODED_AT_ONCE + 8
    sample = TensorDict({"row": torch.arange(n)}, batch_size=[n])
    made.agent.decode = lambda rows: (decoded.append(len(rows)), rows)[1]  # type: ignore[method-assign]
    losses = made.learn(sample, made.agent)
    assert decoded == [DECODED_AT_ONCE, DECODED_AT_ONCE, 8]
    assert set(sizes) == {4}
    assert len(losses) == len(sample) // 4


def test_the_cost_of_a_failure_is_the_step_limit():
    """Two models of equal moves on what they solve: the one that solves more costs less."""
    reach = wide_hand(3, 4)
    instances = InstanceSet.generate(reach, 40, Difficulty(2, 4), "validation", 0)
    evaluator = PerformanceTest(instances, 2, 40, 1.0, 10, 8, 0)
    agent = make_agent("sequential", False, reach)
    result = evaluator.run(agent.greedy)
    assert 0 < result.success < 1
    solved = result.success * result.rearrangements
    assert result.cost == pytest.approx(solved + (1 - result.success) * 8)
    never = evaluator.run(lambda episodes: (episodes.target, episodes.target))
    assert (never.success, never.rearrangements, never.cost) == (0.0, None, 8.0)
    assert not never.passed
