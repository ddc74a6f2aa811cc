"""Instances chosen by their density and by the proved fewest moves that solve them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from dore.errors import InputError, number, seed_of, whole
from dore.world.generator import PATIENCE, Difficulty, FreshInstances, InstanceSource
from dore.world.instances import MOST_INSTANCES, InstanceSet, first_of_each
from dore.world.labeller import Labeller
from dore.world.problem import Batch
from dore.world.reach import Reach

DRAWN = 128
"""Instances drawn at once."""


class ChosenInstances(InstanceSource):
    """New instances of one split, each kept with a chance that depends on its proved fewest moves.

    Args:
        fresh: draws them.
        keep: the chance that an instance of 1, 2, ... moves is kept; the last holds for longer ones too.
        max_nodes, max_moves: see `Labeller`; what it does not decide is left out, as is what has no plan.
    """

    def __init__(self, fresh: FreshInstances, keep: Sequence[float], max_nodes: int, max_moves: int) -> None:
        super().__init__(fresh.reach, 0)
        self.generator = fresh.generator
        self._fresh, self._keep = fresh, torch.tensor([0.0, *keep])
        self._labeller = Labeller(fresh.reach, max_nodes, max_moves, "instances")
        self._left = Batch(*(part[:0] for part in fresh.draw(0)))

    def draw(self, n: int) -> Batch:
        """The next `n` instances.

        Raises:
            InputError: none is found.
        """
        parts, found, stale = [self._left], len(self._left.target), 0
        while found < n:
            part = self._choose(self._fresh.draw(DRAWN))
            stale = stale + 1 if not len(part.target) else 0
            if stale == PATIENCE:
                raise InputError(f"instances: none of {PATIENCE * DRAWN} has a length that instances.keep keeps")
            parts.append(part)
            found += len(part.target)
        board, target = (torch.cat(column) for column in zip(*parts, strict=True))
        self._left = Batch(board[n:], target[n:])
        return Batch(board[:n], target[:n])

    def _choose(self, drawn: Batch) -> Batch:
        fewest = self._labeller.fewest(drawn).long()
        chance = self._keep[fewest.clamp(0, len(self._keep) - 1)]
        luck = torch.rand(len(chance), generator=self.generator, device=self.generator.device).cpu()
        kept = ((fewest > 0) & (luck < chance)).to(drawn.target.device)
        return Batch(drawn.board[kept], drawn.target[kept])

    def seed(self, seed: int) -> None:
        """Start over from `seed`."""
        self._fresh.seed(seed)
        self._left = Batch(*(part[:0] for part in self._left))

    def state_dict(self) -> dict[str, Tensor]:
        """All that `draw` depends on."""
        fresh = {f"fresh.{name}": value for name, value in self._fresh.state_dict().items()}
        return {**fresh, "board": self._left.board.clone(), "target": self._left.target.clone()}

    def load_state_dict(self, state: dict[str, Tensor]) -> None:
        """Continue as the source whose `state_dict` this is."""
        self._fresh.load_state_dict({name.partition(".")[2]: state[name] for name in state if "." in name})
        device = self.reach.device
        self._left = Batch(state["board"].to(device), state["target"].to(device))


@dataclass(frozen=True)
class OptimumSplits:
    """The three splits, as in `InstanceSplits`, of instances chosen by density and by their fewest moves.

    Args:
        min_density, max_density: the share of the cells that hold an obstacle, at least one obstacle.
        keep: see `ChosenInstances`.
        max_nodes, max_moves: of the search that proves the fewest moves, see `Labeller`.
        validation_size, test_size: how many instances these sets hold.
        seed: of the sets.

    Raises:
        InputError: a number outside its domain.
    """

    min_density: float
    max_density: float
    keep: Sequence[float]
    max_nodes: int
    max_moves: int
    validation_size: int
    test_size: int
    seed: int

    def __post_init__(self) -> None:
        number("instances.min_density", self.min_density, above=-1e-12, at_most=1.0)
        number("instances.max_density", self.max_density, above=0.0, at_most=1.0)
        if self.min_density > self.max_density:
            raise InputError(f"instances.min_density: {self.min_density} is above max_density {self.max_density}")
        if not isinstance(self.keep, Sequence) or isinstance(self.keep, str) or not self.keep:
            raise InputError(f"instances.keep: got {self.keep!r}, want a list of chances, for 1, 2, ... moves")
        for chance in self.keep:
            number("instances.keep", chance, above=-1e-12, at_most=1.0)
        if not any(self.keep):
            raise InputError(f"instances.keep: got {list(self.keep)}, want one above 0")
        for name in ("validation_size", "test_size"):
            whole(f"instances.{name}", getattr(self, name), 1, at_most=MOST_INSTANCES)
        seed_of("instances.seed", self.seed)

    def train(self, reach: Reach, seed: int) -> ChosenInstances:
        """Where training episodes come from; `seed` is the run's."""
        return self.new(reach, "train", seed)

    def validation(self, reach: Reach) -> InstanceSet:
        """What the IPT draws from."""
        return self._set(reach, "validation", self.validation_size)

    def test(self, reach: Reach) -> InstanceSet:
        """Used once, at the end."""
        return self._set(reach, "test", self.test_size)

    def most_obstacles(self, n_cells: int) -> int:
        """The most that an instance may have."""
        return _count(self.max_density, n_cells)

    def new(self, reach: Reach, split: str, seed: int) -> ChosenInstances:
        """New instances of a split without end."""
        difficulty = Difficulty(_count(self.min_density, reach.n_cells), self.most_obstacles(reach.n_cells))
        fresh = FreshInstances(reach, difficulty, split, seed)
        return ChosenInstances(fresh, self.keep, self.max_nodes, self.max_moves)

    def _set(self, reach: Reach, split: str, size: int) -> InstanceSet:
        """Different ones, in the order in which they are first drawn."""
        source = self.new(reach, split, self.seed)
        found = torch.empty(0, reach.n_words + 1, dtype=torch.int64, device=reach.device)
        asked = 0
        while len(found) < size:
            asked += size
            if asked > PATIENCE * size:
                raise InputError(f"instances: asked for {size} different ones of the {split} split, got {len(found)}")
            board, target = source.draw(size)
            found = first_of_each(torch.cat([found, torch.cat([board, target[:, None]], -1)]))
        return InstanceSet(reach, found[:size, :-1].contiguous(), found[:size, -1].contiguous())


def _count(density: float, n_cells: int) -> int:
    """How many obstacles a density stands for, at least one."""
    return max(1, round(density * n_cells))
