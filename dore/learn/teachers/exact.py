"""A teacher that knows the optimal moves: exact labels for the boards that the policy visits.

B denotes the batch, G the cells, P the bytes of a board's labels.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from dore.errors import InputError, number, whole
from dore.learn import keys
from dore.learn.agents.common import Agent
from dore.learn.agents.sequential import Sequential
from dore.learn.replay import compact
from dore.learn.teachers.packing import packed, unpacked
from dore.world.board import bit, same
from dore.world.generator import SPLITS, split_share
from dore.world.labeller import Labeller
from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.rules import lift

LABELS = ("teacher", "labels")
"""UInt8[B, P]: what each move of the board wastes, `dore.learn.teachers.packing`."""
LABELLED = ("teacher", "labelled")
"""Bool[B]: some move has a label."""


class ExactTeacher:
    """Labels boards by exact search, as the policy plays: each move by how much longer it makes the shortest plan.

    The boards are those of the learner's own episodes (DAgger, Ross and others, 2011): its policy acts, except for the
    share of moves that the teacher makes and for random exploration. A board of the test split gets no label, nor does
    one on which the search gives up.

    Args:
        reach: of the boards.
        max_nodes, max_moves: see `Labeller`.
        enough: how many boards may be expanded to label one step of all environments; the step's other boards get no
            label. It keeps a world with hard boards from taking all the time.
        optimal: the share of moves that the teacher makes.

    Raises:
        InputError: a number outside its domain.
    """

    bootstraps = True
    """Whether the loss uses the target networks."""

    def __init__(self, reach: Reach, max_nodes: int, max_moves: int, enough: int, optimal: float) -> None:
        self.reach = reach
        self.labeller = Labeller(reach, max_nodes, max_moves)
        self.enough = whole("teacher.enough", enough, 1)
        self.optimal = number("teacher.optimal", optimal, above=-1e-12, at_most=1.0)

    def check(self, agent: Sequential) -> None:
        """Raise InputError where this agent cannot be taught."""

    @abstractmethod
    def decode(self, batch: TensorDictBase, agent: Sequential) -> TensorDictBase:
        """Stored steps, with everything that the loss needs."""

    @abstractmethod
    def loss(self, decoded: TensorDictBase, agent: Sequential) -> TensorDict:
        """loss_pick and loss_place of a decoded batch."""

    def act(self, observed: TensorDictBase, policy: Callable[[TensorDictBase], TensorDictBase]) -> TensorDictBase:
        """The observation with actions, the policy's or the teacher's, and with labels."""
        board, target = observed[keys.BOARD], observed[keys.TARGET]
        wasted = self._label(board, target)
        step = policy(observed)
        best = (wasted == 0).flatten(1)
        has_best = best.any(-1)
        move = torch.multinomial((best | ~has_best[:, None]).float(), 1).squeeze(-1)
        pick, place = move // self.reach.n_cells, move % self.reach.n_cells
        after = lift(board, pick) | bit(place, self.reach.n_words)
        goes_back = same(observed[keys.VISITED], after[:, None]).any(-1)
        taught = has_best & ~goes_back & (torch.rand(len(best), device=best.device) < self.optimal)
        for key, cell in ((keys.PICK, pick), (keys.PLACE, place)):
            step[key] = torch.where(taught, cell, step[key])
        step[LABELS], step[LABELLED] = packed(wasted), (wasted >= 0).flatten(1).any(-1)
        return step

    def kept(self, step: TensorDictBase, agent: Agent) -> TensorDict:
        """TensorDict[M]: those steps that are stored, in the replay's format."""
        return compact(step[step[LABELLED]], (*agent.stored, LABELS), self.reach.n_cells)

    def _label(self, board: Tensor, target: Tensor) -> Tensor:
        """Int8[B, G, G]: moves wasted; less than 0 everywhere on boards of the test split."""
        allowed = (split_share(board, self.reach) < SPLITS["test"][0]).nonzero().squeeze(-1)
        found = self.labeller.label(Batch(board[allowed], target[allowed]), self.enough).wasted.to(board.device)
        cells = self.reach.n_cells
        wasted = torch.full((len(board), cells, cells), -1, dtype=torch.int8, device=board.device)
        return wasted.index_copy_(0, allowed, found)

    def _labels(self, batch: TensorDictBase) -> Tensor:
        return unpacked(batch[LABELS], self.reach.n_cells)


class Lessons:
    """Decodes stored steps and computes the loss with a teacher's labels, in place of the agent's own methods.

    Raises:
        InputError: the agent is not the separated one, whose heads the labels are for.
    """

    def __init__(self, teacher: ExactTeacher, agent: Agent) -> None:
        if not isinstance(agent, Sequential):
            raise InputError(f"teacher: teaches agent=sequential, got {type(agent).__name__.lower()}")
        teacher.check(agent)
        self.teacher, self.agent = teacher, agent
        self.bootstraps = teacher.bootstraps

    def decode(self, batch: TensorDictBase) -> TensorDictBase:
        """Stored steps, with everything that the loss needs."""
        return self.teacher.decode(batch, self.agent)

    def loss(self, decoded: TensorDictBase) -> TensorDict:
        """loss_pick and loss_place."""
        return self.teacher.loss(decoded, self.agent)
