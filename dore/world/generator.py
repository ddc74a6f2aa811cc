"""An unlimited supply of random problem instances, and the split that each belongs to.

The split is a function of the board alone, the same for a board and its mirror image, which are the same problem. So
training can always draw fresh boards, mirrored or not, and never starts an episode on one of the test split. On
its way an episode does stand on such boards, as on any others: docs/results/trust.md says on how many.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from dore.errors import InputError, seed_of, whole
from dore.world.board import pack
from dore.world.mirror import mirrored_board
from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.rules import has_move, retrievable

SPLITS = {"train": (0.0, 0.7), "validation": (0.7, 0.85), "test": (0.85, 1.0)}
"""Each split's share of all boards. The paper: 70 % train, 30 % test, and training stops on the test set."""
CANDIDATES = 16384
"""Boards drawn at once."""
PATIENCE = 20
"""After this many draws without a new instance no more are expected."""


@dataclass(frozen=True)
class Difficulty:
    """How many obstacles an instance has: uniform on [min_obstacles, max_obstacles] before the drawn board is
    looked at; instances whose target is accessible at the start are discarded (paper, section 5.3), and so
    are those without a legal first move, where no episode could start (the paper is silent on these).

    Raises:
        InputError: counts below 1, or min above max.
    """

    min_obstacles: int
    max_obstacles: int

    def __post_init__(self) -> None:
        whole("instances.min_obstacles", self.min_obstacles, 1)
        whole("instances.max_obstacles", self.max_obstacles, 1)
        if self.min_obstacles > self.max_obstacles:
            raise InputError(
                f"instances.min_obstacles: {self.min_obstacles} is above max_obstacles {self.max_obstacles}"
            )

    def check_fits(self, n_cells: int) -> None:
        """Raise InputError where the obstacles and the target do not fit on `n_cells` cells."""
        if self.max_obstacles + 1 > n_cells:
            raise InputError(
                f"instances.max_obstacles: {self.max_obstacles} obstacles and a target do not fit on {n_cells} cells"
            )


class InstanceSource:
    """Where an environment's episodes come from; its choices are those of a generator of its own.

    Args:
        reach: what the instances are blocked under.
        seed: of the generator.
        device: the generator's.
    """

    def __init__(self, reach: Reach, seed: int, device: torch.device | str = "cpu") -> None:
        self.reach = reach
        self.generator = torch.Generator(device).manual_seed(seed_of("instances.seed", seed))

    def draw(self, n: int) -> Batch:
        """The next `n` instances."""
        raise NotImplementedError

    def seed(self, seed: int) -> None:
        """Start over from `seed`."""
        self.generator.manual_seed(seed_of("instances.seed", seed))

    def state_dict(self) -> dict[str, Tensor]:
        """All that `draw` depends on."""
        return {"generator": self.generator.get_state()}

    def load_state_dict(self, state: dict[str, Tensor]) -> None:
        """Continue as the source whose `state_dict` this is."""
        self.generator.set_state(state["generator"])


class FreshInstances(InstanceSource):
    """Draws new boards of one split, as many as are wanted, on the reach's device."""

    def __init__(self, reach: Reach, difficulty: Difficulty, split: str, seed: int) -> None:
        super().__init__(reach, seed, reach.device)
        difficulty.check_fits(reach.n_cells)
        if split not in SPLITS:
            raise InputError(f"instances.split: got {split!r}, want one of {', '.join(SPLITS)}")
        self.difficulty = difficulty
        self.split = split
        self._left = Batch(
            torch.empty(0, reach.n_words, dtype=torch.int64, device=reach.device),
            torch.empty(0, dtype=torch.int64, device=reach.device),
        )

    def candidates(self) -> Batch:
        """Some instances: as many of `CANDIDATES` random boards as qualify."""
        low, high, n_cells = self.difficulty.min_obstacles, self.difficulty.max_obstacles, self.reach.n_cells
        device = self.reach.device
        keys = torch.rand(CANDIDATES, n_cells, generator=self.generator, device=device)
        cells = keys.topk(high + 1).indices
        n_obstacles = torch.randint(low, high + 1, (CANDIDATES, 1), generator=self.generator, device=device)
        target, cells = cells[:, 0], cells[:, 1:]
        there = torch.arange(high, device=device) < n_obstacles
        occupied = torch.zeros(CANDIDATES, n_cells, dtype=torch.bool, device=device).scatter_(1, cells, there)
        board = pack(occupied)
        low_share, high_share = SPLITS[self.split]
        share = split_share(board, self.reach)
        keep = (share >= low_share) & (share < high_share) & ~retrievable(self.reach, board, target)
        board, target = board[keep], target[keep]
        playable = has_move(self.reach, board, target)
        return Batch(board[playable], target[playable])

    def draw(self, n: int) -> Batch:
        """The next `n` instances.

        Raises:
            InputError: no instance is found, for example because the boards are too sparse.
        """
        parts, found, stale = [self._left], len(self._left.target), 0
        while found < n:
            part = self.candidates()
            stale = stale + 1 if not len(part.target) else 0
            if stale == PATIENCE:
                raise InputError(f"instances: no board of the {self.split} split blocks its target")
            parts.append(part)
            found += len(part.target)
        board = torch.cat([part.board for part in parts])
        target = torch.cat([part.target for part in parts])
        self._left = Batch(board[n:], target[n:])
        return Batch(board[:n], target[:n])

    def seed(self, seed: int) -> None:
        """Start over from `seed`."""
        super().seed(seed)
        self._left = Batch(self._left.board[:0], self._left.target[:0])

    def state_dict(self) -> dict[str, Tensor]:
        """The generator's state and the instances drawn ahead."""
        return {**super().state_dict(), "board": self._left.board.clone(), "target": self._left.target.clone()}

    def load_state_dict(self, state: dict[str, Tensor]) -> None:
        """Continue as the source whose `state_dict` this is."""
        super().load_state_dict(state)
        self._left = Batch(state["board"].to(self.reach.device), state["target"].to(self.reach.device))


def split_share(board: Tensor, reach: Reach) -> Tensor:
    """Float64[B]: each board's place in [0, 1), the same for a board and its mirror image (splitmix64)."""
    share = hashed(board)
    if reach.mirror is not None:
        share = torch.minimum(share, hashed(mirrored_board(board, reach)))
    # The lower of two uniform numbers is not uniform: 1 - (1 - u)^2 is.
    return 1 - (1 - share) ** 2 if reach.mirror is not None else share


def hashed(board: Tensor) -> Tensor:
    """Float64[B] in [0, 1) from Int64[B, W] (splitmix64)."""
    value = torch.zeros_like(board[:, 0])
    for word in range(board.shape[1]):
        value = value + board[:, word] - 7046029254386353131
        value = (value ^ _shift(value, 30)) * -4658895280553007687
        value = (value ^ _shift(value, 27)) * -7723592293110705685
        value = value ^ _shift(value, 31)
    return _shift(value, 11).double() / 2**53


def _shift(value: Tensor, bits: int) -> Tensor:
    """A logical right shift; torch's own keeps the sign."""
    return (value >> bits) & ((1 << (64 - bits)) - 1)
