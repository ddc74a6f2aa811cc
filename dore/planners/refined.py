"""The greedy policy of a trained model with rules that shorten its plans."""

from __future__ import annotations

import torch
from torch import Tensor

from dore.planners.base import RawPlan
from dore.planners.learned import Backtracking
from dore.planners.policy import winning_else
from dore.planners.shorten import shortened
from dore.world.episode import Episodes
from dore.world.mirror import mirrored_board, mirrored_cell
from dore.world.plan import Status
from dore.world.problem import Batch


class Refined(Backtracking):
    """As `Backtracking`, with three rules that need no network.

    It makes a winning move, one that makes the target accessible, where there is one. Its plan is shortened by what
    replays allow (`dore.planners.shorten`). And it plans each instance and its mirror image, where the layout has one,
    and returns the better plan: the networks are not symmetric. No tree of boards is searched.
    """

    name = "refined"

    def choose(self, episodes: Episodes) -> tuple[Tensor, Tensor]:
        """A winning move of each episode, or the network's."""
        return winning_else(self.reach, episodes, super().choose(episodes))

    def raw_plans(self, batch: Batch) -> list[RawPlan]:
        """The better of the plans of each instance and its mirror image; all episodes are played at once."""
        n = len(batch.target)
        if self.reach.mirror is None:
            return shortened(self.reach, batch, super().raw_plans(batch))
        images = Batch(mirrored_board(batch.board, self.reach), mirrored_cell(batch.target, self.reach))
        both = Batch(*(torch.cat(fields) for fields in zip(batch, images, strict=True)))
        plans = shortened(self.reach, both, super().raw_plans(both))
        mirror = self.reach.mirror.tolist()
        return [_better(plan, _mirrored(image, mirror)) for plan, image in zip(plans[:n], plans[n:], strict=True)]


def _mirrored(plan: RawPlan, mirror: list[int]) -> RawPlan:
    return plan._replace(moves=[(mirror[pick], mirror[place]) for pick, place in plan.moves])


def _better(plan: RawPlan, other: RawPlan) -> RawPlan:
    """The one that solves, of two that do the shorter one; with the time and the expansions of both."""
    first = min(plan, other, key=lambda one: (one.status is not Status.SOLVED, len(one.moves)))
    return first._replace(planning_s=plan.planning_s + other.planning_s, expansions=plan.expansions + other.expansions)
