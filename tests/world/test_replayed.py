"""The compiled replay accepts what the replay from the geometry accepts, and nothing else."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from dore.planners.compiled import Compiled
from dore.planners.exact import Exact
from dore.world.board import bit, pack
from dore.world.generator import Difficulty
from dore.world.instances import InstanceSet, problems_of
from dore.world.kernels import slices
from dore.world.kernels.tables import unsigned
from dore.world.layout import Layout
from dore.world.plan import Move, Plan, PlanError, Status, replay
from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.replayed import Moves, replayed
from tests.drawings import PUBLISHED, WIDE_HAND, wide_hand

REACHES = {
    "3x5": wide_hand(3, 5),
    "lateral": Reach(Layout.grid(4, 5, 0.12), **PUBLISHED, staging_m=0.05, lateral_limit_m=0.2),  # type: ignore[arg-type]
    "two words": Reach(Layout.grid(9, 9, 0.09), **WIDE_HAND, max_yaw_deg=20.0),  # type: ignore[arg-type]
}


def arrays(batch: Batch) -> tuple[np.ndarray, np.ndarray]:
    """Boards and targets as the kernels take them."""
    return unsigned(batch.board), batch.target.numpy()


def random_plans(reach: Reach, n: int) -> tuple[Batch, Moves]:
    """Boards of up to 70 % density, and up to two moves of each, half of them of an obstacle, some off the board."""
    generator, g = torch.Generator().manual_seed(reach.n_cells), reach.n_cells
    occupied = torch.rand(n, g, generator=generator) < 0.7 * torch.rand(n, 1, generator=generator)
    target = torch.randint(g, (n,), generator=generator)
    occupied[torch.arange(n), target] = False
    cells = torch.randint(-1, g + 1, (n, 4), generator=generator)
    cells[::2, 0] = (occupied + 0.3 * torch.rand(n, g, generator=generator)).argmax(-1)[::2]
    cells[::4, 2] = cells[::4, 1]
    n_moves = torch.randint(3, (n,), generator=generator).numpy()
    solved = (torch.rand(n, generator=generator) < 0.3).numpy()
    return Batch(pack(occupied), target), Moves(cells.to(torch.int32).numpy(), n_moves, solved)


@pytest.mark.parametrize("name", REACHES)
def test_it_agrees_with_the_geometry(name: str) -> None:
    """Plan by plan, with the directions that it finds, which are those of `Reach.direction_deg`."""
    reach, right = REACHES[name], 0
    batch, moves = random_plans(reach, 600)
    for row, problem in enumerate(problems_of(reach, batch)):
        alone = Batch(batch.board[row, None], batch.target[row, None])
        found = replayed(reach, *arrays(alone), Moves(*(field[row, None] for field in moves)))
        n_moves = int(moves.n_moves[row])
        degrees = found.directions(0, n_moves)
        pairs = moves.cells[row, : 2 * n_moves].reshape(-1, 2).tolist()
        done = [Move(*pair, *degrees[2 * k : 2 * k + 2]) for k, pair in enumerate(pairs)]
        status = Status.SOLVED if moves.solved[row] else Status.GAVE_UP
        plan = Plan(status, tuple(done), degrees[-1] if moves.solved[row] else None, "test", 0.0)
        if not found.n_right:
            with pytest.raises(PlanError):
                replay(problem, plan)
            continue
        right += 1
        boards = replay(problem, plan)
        for move, before in zip(done, boards, strict=False):
            standing = pack(torch.tensor([[c in before - {move.pick} for c in range(reach.n_cells)]]))
            standing |= bit(alone.target, reach.n_words)
            for cell, direction in ((move.pick, move.pick_direction_deg), (move.place, move.place_direction_deg)):
                assert direction == reach.direction_deg(standing, torch.tensor([cell])).item()
        assert moves.solved[row] != math.isnan(degrees[-1])
    assert 100 < right < 500


def test_the_first_wrong_plan_is_named() -> None:
    reach = REACHES["3x5"]
    batch, moves = random_plans(reach, 50)
    idle = moves._replace(n_moves=np.zeros(50, np.int64), solved=np.zeros(50, np.bool_))
    assert replayed(reach, *arrays(batch), idle).n_right == 50
    idle.n_moves[[20, 30]] = 1
    idle.cells[[20, 30], 0] = -1
    assert replayed(reach, *arrays(batch), idle).n_right == 20


class Wrong(Exact):
    """An exact search that is wrong about some plans."""

    group = 8

    def _search(self, boards: np.ndarray, targets: np.ndarray) -> slices.Found:
        found = super()._search(boards, targets)
        if len(targets) == 4:
            found.moves[2, 1] = found.moves[2, 0]
        return found


def test_no_plan_leaves_unproved() -> None:
    reach = wide_hand(5, 5)
    batch = InstanceSet.generate(reach, 20, Difficulty(6, 6), "test", 0).batch()
    with pytest.raises(PlanError, match=r"^exact, instance 19: move 1 \(\d+ to \d+\): goes back to an earlier board"):
        Wrong(reach, 10**6, 60.0, 500.0).plan(batch)


def test_plans_are_made_when_they_are_asked_for() -> None:
    reach = wide_hand(5, 5)
    batch = InstanceSet.generate(reach, 20, Difficulty(6, 6), "test", 0).batch()
    planner: Compiled = Exact(reach, 10**6, 60.0, 500.0)
    planner.group = 8
    plans = planner.plan(batch)
    assert len(plans) == 20
    assert plans[-1] == plans[19] == list(plans)[19] == plans[17:][2]
    for problem, plan, raw_plan in zip(problems_of(reach, batch), plans, planner.raw_plans(batch), strict=True):
        replay(problem, plan)
        assert [(move.pick, move.place) for move in plan.moves] == raw_plan.moves
        assert (plan.status, plan.optimal_moves) == (raw_plan.status, raw_plan.optimal_moves)
        assert planner.plan_one(problem).moves == plan.moves
    with pytest.raises(IndexError):
        plans[20]
