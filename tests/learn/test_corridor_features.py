"""What the corridors say of each cell, against the definition worked out a cell at a time."""

from __future__ import annotations

import pytest
import torch

from dore.learn.corridor_features import corridor_costs, corridor_planes
from dore.learn.features import encode, n_planes
from dore.planners.exact import Exact
from dore.world.board import bit, pack, unpack
from dore.world.generator import Difficulty, FreshInstances
from dore.world.kernels.corridor_costs import LEVELS, N_PLANES, NEVER, SPARE
from dore.world.layout import Layout
from dore.world.plan import Status
from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.rules import accessibility
from tests.drawings import PUBLISHED, WIDE_HAND, cells_of, scene_of, wide_hand
from tests.oracles import corridor_features as oracle
from tests.oracles.bounds import fewest_blocking


def drawn(drawing: str) -> tuple[Reach, torch.Tensor, torch.Tensor]:
    scene = scene_of(drawing)
    rows, cols = scene.layout.grid_shape
    occupied = torch.zeros(1, rows * cols, dtype=torch.bool)
    occupied[0, list(scene.obstacles)] = True
    return wide_hand(rows, cols), pack(occupied), torch.tensor([scene.target])


def test_one_obstacle_in_the_way():
    drawing = """
        . T .
        . o .
        . . .
    """
    reach, board, target = drawn(drawing)
    costs = corridor_costs(reach, board, target)
    (obstacle,) = cells_of(drawing, "o")
    assert costs.now.tolist() == [1]
    assert costs.changed[0, obstacle] == 0, "gone, nothing is left to do"
    assert costs.depth[0, obstacle] == 0, "the hand gets to it"
    assert costs.depth[0, target[0]] == 1


def test_what_stands_before_the_obstacle_counts():
    reach, board, target = drawn("T\no\no\n.")
    costs = corridor_costs(reach, board, target)
    assert costs.now.tolist() == [2]
    assert costs.changed[0].tolist() == [3, 1, 1, 2], "one more in front, one less, one less; the target's own cell"


def by_hand(reach: Reach, standing: set[int], target: int, cell: int | None) -> int:
    """`changed` of a cell (`now` where it is None), from the definition."""
    corridors = [
        set(unpack(corridor, reach.n_cells).nonzero().squeeze(-1).tolist())
        for corridor in reach.blocking_sets[:, target]
    ]
    fewest = min(len(standing & corridor) for corridor in corridors)
    near = [corridor for corridor in corridors if len(standing & corridor) <= fewest + SPARE]
    after = standing ^ {cell} if cell is not None else standing
    return min(
        len(after & corridor) + min(reaching(reach, standing, corridor, target, cell), NEVER) for corridor in near
    )


def reaching(reach: Reach, standing: set[int], corridor: set[int], target: int, cell: int | None) -> int:
    """What it takes to get to the obstacles on one corridor."""
    others, wanted = standing - corridor, standing & corridor
    if not wanted:
        return 0
    there = torch.zeros(1, reach.n_cells, dtype=torch.bool)
    there[0, list(others | {target})] = True
    accessible = reach.accessible(there)[0]
    weight = {obstacle: 1 if accessible[obstacle] else 2 for obstacle in others}
    everyone, first = 0, NEVER
    for obstacle in wanted:
        ways = [way.nonzero().squeeze(-1).tolist() for way in unpack(reach.blocking_sets[:, obstacle], reach.n_cells)]
        costs = []
        for way in ways:
            beside = set(way) - corridor
            cost = NEVER if target in way else sum(weight[blocker] for blocker in beside & others)
            if cell in beside:
                cost += -weight[cell] if cell in standing else 1
            costs.append((cost, NEVER if wanted & set(way) else cost))
        everyone += 0 if obstacle == cell else max(0, min(cost for cost, _ in costs))
        first = min(first, 0 if obstacle == cell else max(0, min(alone for _, alone in costs)))
    return max(everyone, first)


def test_costs_are_those_of_the_definition():
    reach = wide_hand(5, 5)
    board, target = FreshInstances(reach, Difficulty(3, 12), "train", 3).draw(40)
    costs = corridor_costs(reach, board, target)
    for row in range(40):
        standing = set(unpack(board[row], 25).nonzero().squeeze(-1).tolist())
        goal = int(target[row])
        assert int(costs.now[row]) == by_hand(reach, standing, goal, None)
        for cell in set(range(25)) - {goal}:
            assert min(int(costs.changed[row, cell]), NEVER) == min(by_hand(reach, standing, goal, cell), NEVER)


def test_blocking_is_the_fewest_on_a_corridor_once_the_cell_is_changed():
    reach = wide_hand(8, 8)
    board, target = FreshInstances(reach, Difficulty(3, 13), "train", 1).draw(30)
    costs = corridor_costs(reach, board, target)
    for cell in range(64):
        changed = board ^ bit(torch.full_like(target, cell), 1)
        assert torch.equal(costs.blocking[:, cell].long(), fewest_blocking(reach, Batch(changed, target)))


def test_a_row_is_what_it_is_alone_and_shapes_fit():
    reach = wide_hand(4, 6)
    board, target = FreshInstances(reach, Difficulty(3, 9), "train", 2).draw(20)
    planes = corridor_planes(reach, board, target)
    assert planes.shape == (20, N_PLANES, 24)
    assert planes[:, : 4 * LEVELS].unflatten(1, (4, LEVELS)).sum(2).eq(1).all(), "one level of each cost"
    alone = torch.cat([corridor_planes(reach, board[row, None], target[row, None]) for row in range(20)])
    assert torch.equal(planes, alone)
    mask = accessibility(reach, board, target).place
    assert encode(reach, board, target, mask, "lanes").shape[1] == n_planes("lanes", with_mask=True)


def test_a_changed_cost_is_nearly_that_of_the_changed_board():
    """Which corridors are near, and what can be reached, is not worked out again for each cell."""
    reach = wide_hand(6, 6)
    board, target = FreshInstances(reach, Difficulty(3, 8), "train", 4).draw(200)
    changed = corridor_costs(reach, board, target).changed
    same = total = 0
    for cell in range(36):
        rows = target != cell
        after = board[rows] ^ bit(torch.full_like(target[rows], cell), 1)
        same += int((corridor_costs(reach, after, target[rows]).now == changed[rows, cell]).sum())
        total += int(rows.sum())
    assert same / total > 0.95


@pytest.mark.parametrize(("size", "most"), [(6, 8), (8, 13)])
def test_the_cost_is_mostly_the_proved_optimum_and_seldom_above_it(size, most):
    """It is an estimate, no bound: docs/learning.md says that it is exact on 97 to 98 % of such boards."""
    reach = wide_hand(size, size)
    batch = FreshInstances(reach, Difficulty(3, most), "validation", 7).draw(300)
    plans = Exact(reach, max_nodes=100_000, max_seconds=60.0, max_memory_mb=500.0).plan(batch)
    solved = torch.tensor([plan.status is Status.SOLVED for plan in plans])
    fewest = torch.tensor([plan.optimal_moves for plan in plans if plan.status is Status.SOLVED])
    now = corridor_costs(reach, *batch).now
    assert (now >= fewest_blocking(reach, batch)).all(), "never below the plain count of obstacles"
    assert (now[solved] == fewest).float().mean() > 0.95
    assert (now[solved] > fewest).float().mean() < 0.02
    several = fewest > 2
    assert (now[solved] == fewest)[several].float().mean() > 0.85, "also where the plan is long"


@pytest.mark.parametrize(
    ("rows", "cols", "density", "keys"),
    [
        (3, 6, 0.55, PUBLISHED),
        (6, 6, 0.2, WIDE_HAND),
        (8, 8, 0.4, WIDE_HAND),
        (10, 10, 0.3, WIDE_HAND),
    ],
)
def test_compiled_costs_are_those_of_tensors(rows, cols, density, keys):
    reach = Reach(Layout.grid(rows, cols, 0.12), **(WIDE_HAND | keys), max_yaw_deg=40.0)
    board = pack(torch.rand(200, rows * cols, generator=torch.Generator().manual_seed(rows)) < density)
    target = torch.arange(200) % (rows * cols)
    board = board & ~bit(target, board.shape[-1])
    assert torch.equal(corridor_planes(reach, board, target), oracle.corridor_planes(reach, board, target))
    ours, theirs = corridor_costs(reach, board, target), oracle.corridor_costs(reach, board, target)
    assert all(torch.equal(a, b.long()) for a, b in zip(ours, theirs, strict=True))
