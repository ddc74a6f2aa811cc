"""The experience memory of one instance (Algorithm 1, line 6), which transfer learning learns from."""

from __future__ import annotations

from functools import partial

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.data import LazyTensorStorage, ReplayBuffer

from dore.learn import keys
from dore.world.board import bit
from dore.world.instances import FixedInstances, InstanceSet
from dore.world.problem import Batch
from dore.world.rules import accessibility, lift

CAPACITY = 2**18
"""Transitions kept, each in some 40 bytes."""
WAY_SHARE = 0.5
"""The share of a sample that comes from the way to the target, once one is known."""
RETURN_SHARE = 0.9
"""The share of episodes that start at a board that was reached before."""
CLOSED = 256
"""Where more boards than this have been reached, none of them is searched for a way out."""

Board = tuple[int, ...]
"""A board's words."""


class InstanceMemory(ReplayBuffer):
    """Transitions of one instance, the boards they reach, and the shortest way to the target through them.

    The paper does not say how its memory is made. Here as in Go-Explore (Ecoffet and others, 2021): most episodes
    start at a board that was reached before (`Returning`), so that exploring continues from there; and once an episode
    has ended at the target, half of each sample is the way to it, pieced together from the transitions of many
    episodes.

    Args:
        instance: a set of one.
    """

    def __init__(self, instance: InstanceSet) -> None:
        super().__init__(storage=partial(LazyTensorStorage, CAPACITY, device=instance.reach.device))
        self.instance = instance
        self.way: Tensor | None = None
        """Int64[L]: its transitions. Where the memory has since been written over, others of this instance."""
        self.boards: list[Board] = [tuple(instance.board[0].tolist())]
        """The different boards from which the target is not accessible."""
        # Of each board, the fewest moves to it so far, and the last of these: from which board, which transition.
        self._reached: dict[Board, tuple[int, Board | None, int]] = {self.boards[0]: (0, None, -1)}
        self._fewest: int | None = None
        self._grown = False

    def extend(self, data: TensorDictBase, *, update_priority: bool | None = None) -> Tensor:  # type: ignore[override]
        """Keep transitions; returns their places."""
        places = super().extend(data, update_priority=update_priority)
        self._grown = False
        rows = zip(
            places.tolist(),
            data[keys.BOARD].tolist(),
            data["next", keys.BOARD].tolist(),
            (data["next", *keys.PLACE_REWARD].squeeze(-1) > 0).tolist(),
            strict=True,
        )
        for place, before, after, solved in rows:
            self._note(place, tuple(before), tuple(after), solved)
        return places

    def sample(self, batch_size: int) -> TensorDictBase:  # type: ignore[override]
        """Transitions drawn at random, the known way among them."""
        if self.way is None:
            return super().sample(batch_size)
        of_way = int(WAY_SHARE * batch_size)
        by_chance = torch.randint(len(self.way), (of_way,), device=self.way.device)
        return torch.cat([super().sample(batch_size - of_way), self[self.way[by_chance]]])

    def exhausted(self) -> bool:
        """Whether these are all boards that can be reached, and none opens the target: there is no plan.

        False proves nothing: the check is skipped while new boards turn up, and where there are many.
        """
        if self._grown or self.way is not None or len(self.boards) > CLOSED:
            return False
        reach, device = self.instance.reach, self.instance.reach.device
        board = torch.tensor(self.boards, device=device)
        target = self.instance.target.expand(len(board))
        source, cell = accessibility(reach, board, target).pick.nonzero(as_tuple=True)
        lifted = lift(board[source], cell)
        pair, cell = accessibility(reach, lifted, target[source]).place.nonzero(as_tuple=True)
        after = lifted[pair] | bit(cell, lifted.shape[-1])
        return {tuple(words) for words in after.tolist()} <= self._reached.keys()

    def _note(self, place: int, before: Board, after: Board, solved: bool) -> None:
        """Remember where a transition leads, and the way to the target that it may complete."""
        moves = self._reached[before][0] + 1
        known = self._reached.get(after)
        if known is None and not solved:
            self.boards.append(after)
            self._grown = True
        if known is None or moves < known[0]:
            self._reached[after] = (moves, before, place)
        if solved and (self._fewest is None or moves < self._fewest):
            self._fewest, self.way = moves, self._way_to(after)

    def _way_to(self, board: Board) -> Tensor:
        """Int64[L]: the transitions from the start to a board."""
        places = []
        step: Board | None = board
        while step is not None:
            _, step, place = self._reached[step]
            places.append(place)
        return torch.tensor(places[-2::-1], device=self.instance.reach.device)


class Returning(FixedInstances):
    """Starts episodes at the instance's board or, mostly, at one that its memory holds, each as likely."""

    def __init__(self, memory: InstanceMemory, seed: int) -> None:
        super().__init__(memory.instance, seed)
        self.memory = memory

    def draw(self, n: int) -> Batch:
        """`n` starts."""
        board, target = super().draw(n)
        known = self.memory.boards
        of_memory = int((torch.rand(n, generator=self.generator) < RETURN_SHARE).sum())
        chosen = torch.randint(len(known), (of_memory,), generator=self.generator).tolist()
        if chosen:
            board[:of_memory] = torch.tensor([known[one] for one in chosen], device=board.device)
        return Batch(board, target)
