"""One policy, one episode: the fast greedy path and the batched rollout do what the TensorDict policy does in the env.

The networks have whole-number weights, so that their sums are exact and no rounding decides between two cells.
"""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict
from torch import Tensor, nn
from torchrl.envs.utils import ExplorationType, set_exploration_type

from dore.learn import keys
from dore.learn.agents.common import Agent
from dore.learn.env import RearrangeEnv
from dore.learn.rollout import greedy_rollout
from dore.world.board import bit, contains, pack
from dore.world.episode import begin, resumed
from dore.world.layout import Layout
from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.rules import Failure
from tests.drawings import PUBLISHED, WIDE_HAND
from tests.worlds import REWARDS, Given, make_agent

BOARDS, MOVES = 2000, 6
SPREAD = tuple((0.45 + 0.11 * (i // 5) + 0.02 * (i % 3), 0.13 * (i % 5) - 0.26) for i in range(17))
REACHES = {
    "3x6": Reach(Layout.grid(3, 6, 0.12), **WIDE_HAND),
    "irregular": Reach(Layout(SPREAD, 0.1), **PUBLISHED),
    "column": Reach(Layout.grid(5, 1, 0.12), **WIDE_HAND),
    "two words": Reach(Layout.grid(7, 10, 0.09), **WIDE_HAND),
}
EVERY_FORM = pytest.mark.parametrize(
    ("kind", "literal", "where"),
    [(kind, literal, where) for kind in ("sequential", "single") for literal in (False, True) for where in REACHES],
)


class WholeNumbers(nn.Module):
    """A network whose weights, and so values, are small whole numbers."""

    def __init__(self, reach: Reach, n_planes: int, n_outputs: tuple[int, ...]) -> None:
        super().__init__()
        self.hidden = nn.Linear(n_planes * reach.n_cells, 64)
        self.heads = nn.ModuleList(nn.Linear(64, n) for n in n_outputs)
        with torch.no_grad():
            for parameter in self.parameters():
                parameter.copy_(torch.randint_like(parameter, -9, 10))

    def forward(self, observation: Tensor) -> tuple[Tensor, ...]:
        hidden = torch.relu(self.hidden(observation.flatten(1)))
        return tuple(head(hidden) for head in self.heads)


def random_batch(reach: Reach, n: int) -> Batch:
    """Boards of all densities up to two thirds; solved ones, and ones without a move, among them."""
    generator = torch.Generator().manual_seed(reach.n_cells)
    target = torch.randint(reach.n_cells, (n,), generator=generator)
    share = 0.67 * torch.rand(n, 1, generator=generator)
    occupied = torch.rand(n, reach.n_cells, generator=generator) < share
    return Batch(pack(occupied.scatter(1, target[:, None], False)), target)


def case(kind: str, literal: bool, where: str) -> tuple[Agent, Reach, Batch]:
    reach = REACHES[where]
    mirrored = reach.mirror is not None
    agent = make_agent(kind, literal, reach, slots=12, network=WholeNumbers, mirrored=mirrored)
    return agent, reach, random_batch(reach, BOARDS)


def acted(agent: Agent, observation: TensorDict) -> TensorDict:
    """What the policy adds to an observation, where it does not explore."""
    agent.set_epsilon(1.0)
    with torch.no_grad(), set_exploration_type(ExplorationType.DETERMINISTIC):
        return agent.policy(observation)


@EVERY_FORM
def test_the_greedy_path_is_the_policy_without_exploration(kind: str, literal: bool, where: str) -> None:
    """On random boards with random histories, so that going back is ruled out here and there."""
    agent, reach, (board, target) = case(kind, literal, where)
    moved = [board]
    for seed in range(MOVES):
        cells = torch.randint(reach.n_cells, (2, BOARDS), generator=torch.Generator().manual_seed(seed))
        other = board ^ bit(cells[0], board.shape[-1]) ^ bit(cells[1], board.shape[-1])
        moved.append(torch.where(contains(other, target)[:, None], board, other))
    visited = torch.stack(moved, 1)
    episodes = resumed(reach, board, target, visited, torch.zeros_like(target))
    observation = TensorDict(
        {
            keys.BOARD: board,
            keys.TARGET: target,
            keys.VISITED: visited,
            "pick": {"legal": episodes.legal.pick, "accessible": episodes.legal.pickable},
        },
        batch_size=[BOARDS],
    )
    with torch.no_grad():
        pick, place = agent.greedy(episodes)
    chosen = acted(agent, observation)
    assert torch.equal(chosen[keys.PICK], pick)
    assert torch.equal(chosen[keys.PLACE], place)
    assert len(pick.unique()) > 1


@EVERY_FORM
def test_a_greedy_rollout_is_the_policy_in_the_environment(kind: str, literal: bool, where: str) -> None:
    """Moves, failures (NO_LEGAL_MOVE among them) and success, of episodes that can begin."""
    agent, reach, batch = case(kind, literal, where)
    start = begin(reach, batch, MOVES)
    playable = (~start.legal.solved & start.legal.pick.any(-1)).nonzero().squeeze(-1)
    batch = Batch(batch.board[playable], batch.target[playable])
    n = len(playable)
    rollout = greedy_rollout(agent.greedy, reach, batch, MOVES)
    env = RearrangeEnv(reach, Given(reach, batch), n, MOVES, REWARDS)
    observation = env.reset()
    moves: list[list[tuple[int, int]]] = [[] for _ in range(n)]
    failure, solved = torch.zeros(n, dtype=torch.int64), torch.zeros(n, dtype=torch.bool)
    going = torch.ones(n, dtype=torch.bool)
    for _ in range(MOVES):
        step = env.step(acted(agent, observation))
        after = step["next"]
        carried_out = (after[keys.FAILURE] == Failure.NONE) | (after[keys.FAILURE] == Failure.NO_LEGAL_MOVE)
        for row in (going & carried_out).nonzero().squeeze(-1).tolist():
            moves[row].append((int(step[keys.PICK][row]), int(step[keys.PLACE][row])))
        failure = torch.where(going, after[keys.FAILURE], failure)
        solved |= going & (after[keys.PLACE_REWARD].squeeze(-1) == REWARDS.solved)
        going &= ~after[keys.DONE].squeeze(-1)
        observation = after.exclude("reward")
    assert not going.any()
    assert [rollout.moves(row) for row in range(n)] == moves
    assert torch.equal(rollout.failure, failure)
    assert torch.equal(rollout.solved, solved)
    if where == "column" and not literal:
        assert (failure == Failure.NO_LEGAL_MOVE).any()
    if literal:
        assert failure.any()


@EVERY_FORM
def test_episodes_that_cannot_begin_are_named(kind: str, literal: bool, where: str) -> None:
    agent, reach, batch = case(kind, literal, where)
    start, rollout = begin(reach, batch, MOVES), greedy_rollout(agent.greedy, reach, batch, MOVES)
    accessible = start.legal.solved
    assert rollout.solved[accessible].all()
    assert not rollout.n_moves[accessible].any()
    stuck = ~accessible & ~start.legal.pick.any(-1)
    assert stuck.any()
    assert (rollout.failure[stuck] == Failure.NO_LEGAL_MOVE).all()
    assert not rollout.n_moves[stuck].any()


def test_no_move_left_after_the_last_allowed_one_is_named_too() -> None:
    """On one column cell 1 goes to cell 0, after which no move is legal: also where one move is all there is."""
    reach = REACHES["column"]
    occupied = torch.zeros(1, 5, dtype=torch.bool)
    occupied[0, [1, 2, 3]] = True
    batch = Batch(pack(occupied), torch.tensor([4]))
    rollout = greedy_rollout(lambda _: (torch.tensor([1]), torch.tensor([0])), reach, batch, max_moves=1)
    assert rollout.moves(0) == [(1, 0)]
    assert Failure(int(rollout.failure[0])) is Failure.NO_LEGAL_MOVE
