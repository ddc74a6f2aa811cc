"""The accessibility table against an independent implementation, plain geometry and drawings."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
import torch

from dore.world.board import pack
from dore.world.layout import Layout
from dore.world.reach import Reach
from tests.drawings import PUBLISHED, WIDE_HAND, cells_of, grid, wide_hand

REFERENCE = json.loads((Path(__file__).parents[1] / "data/vfh_reference.json").read_text())["cases"]


def random_boards(n_cells: int, n: int, seed: int) -> torch.Tensor:
    """Bool[n, G] of every density."""
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(n, n_cells, generator=generator) < torch.rand(n, 1, generator=generator)


def free_by_geometry(reach: Reach, occupied: set[int], cell: int) -> list[float]:
    """The free sectors of a cell, degrees: the definition word for word, one obstacle at a time."""
    x, y = reach.layout.cells[cell]
    step = 2 * reach.half_fan_deg / (reach.n_sectors - 1)
    free = []
    for sector in range(reach.n_sectors):
        degrees = -reach.half_fan_deg + step * sector
        approach = math.atan2(-y, -x) + math.radians(degrees)
        density = 0
        for other in occupied - {cell}:
            dx, dy = reach.layout.cells[other][0] - x, reach.layout.cells[other][1] - y
            distance = math.hypot(dx, dy)
            half = math.pi / 2 if reach.clearance_m >= distance else math.asin(reach.clearance_m / distance)
            density += abs(math.remainder(math.atan2(dy, dx) - approach, math.tau)) <= half + 1e-9
        if density == 0:
            free.append(degrees)
    return free


def test_agrees_with_the_independent_implementation() -> None:
    assert len(REFERENCE) == 150
    for case in REFERENCE:
        layout = Layout.grid(case["rows"], case["cols"], case["cell_m"], case["front_m"])
        reach = Reach(layout, case["r_m"], case["eta_deg"], 2 * case["eta_deg"])
        occupied = torch.zeros(1, layout.n_cells, dtype=torch.bool)
        occupied[0, case["occupied"]] = True
        assert bool(reach.accessible(occupied)[0, case["cell"]]) is case["accessible"], case


@pytest.mark.parametrize(
    "reach",
    [
        Reach(Layout.grid(10, 10, 0.12), **PUBLISHED),  # type: ignore[arg-type]
        Reach(Layout.grid(10, 10, 0.09), **WIDE_HAND),  # type: ignore[arg-type]
        Reach(Layout.grid(3, 6, 0.12), **WIDE_HAND),  # type: ignore[arg-type]
        Reach(Layout(((0.5, 0.1), (0.52, -0.11), (0.68, 0.02), (0.8, -0.2), (0.81, 0.14)), 0.12), 0.17, 15.0, 7),
    ],
)
def test_agrees_with_plain_geometry(reach: Reach) -> None:
    occupied = random_boards(reach.n_cells, 12, seed=reach.n_cells)
    accessible = reach.accessible(occupied)
    sectors = reach.sectors_deg.tolist()
    for row, there in enumerate(occupied.tolist()):
        standing = {cell for cell, here in enumerate(there) if here}
        for cell in range(reach.n_cells):
            free = free_by_geometry(reach, standing, cell)
            assert bool(accessible[row, cell]) == bool(free), (row, cell)
            table = reach.free_sectors(pack(occupied[row : row + 1]), torch.tensor([cell]))[0].tolist()
            assert [s for s, ok in zip(sectors, table, strict=True) if ok] == pytest.approx(free)
    assert bool(accessible.any())
    assert not bool(accessible.all())


def test_drawing_of_a_wall() -> None:
    drawing = """
        . . . . .
        o o o o o
        . . . . .
        . . . . .
    """
    reach = Reach(Layout.grid(4, 5, 0.12), clearance_m=0.1, half_fan_deg=30.0, n_sectors=60)
    occupied = torch.tensor([[here == "o" for here in "".join(grid(drawing))]])
    # Behind the wall nothing is accessible; the wall itself and all before it are.
    assert reach.accessible(occupied)[0].tolist() == [True] * 15 + [False] * 5


def test_drawing_of_a_gap_in_a_wall() -> None:
    drawing = """
        x x a x x
        x x a x x
        o o . o o
        . . . . .
    """
    reach = Reach(Layout.grid(4, 5, 0.12), clearance_m=0.11, half_fan_deg=10.0, n_sectors=20)
    occupied = torch.tensor([[here == "o" for here in "".join(grid(drawing))]])
    accessible = reach.accessible(occupied)[0]
    assert bool(accessible[cells_of(drawing, "a.o")].all())
    assert not bool(accessible[cells_of(drawing, "x")].any())


def test_a_neighbour_within_the_clearance_covers_a_quarter_turn_to_each_side() -> None:
    # One cell and a neighbour on its left, exactly abreast at the same distance from the base's axis.
    layout = Layout(((0.6, 0.05), (0.6, -0.05)), 0.08)
    reach = Reach(layout, clearance_m=0.11, half_fan_deg=20.0, n_sectors=41)
    both = pack(torch.ones(1, 2, dtype=torch.bool))
    # The base lies 4.76 degrees off the x axis, so a quarter turn from the neighbour ends that far off 0 degrees.
    assert reach.direction_deg(both, torch.tensor([0])).item() == -5.0
    assert reach.direction_deg(both, torch.tensor([1])).item() == 5.0


def test_direction_is_the_free_sector_nearest_0() -> None:
    reach = wide_hand(4, 5)
    occupied = random_boards(20, 200, seed=3)
    row, cell = reach.accessible(occupied).nonzero(as_tuple=True)
    chosen = reach.direction_deg(pack(occupied[row]), cell)
    assert chosen.dtype is torch.float64
    for there, one, degrees in list(zip(occupied[row].tolist(), cell.tolist(), chosen.tolist(), strict=True))[::5]:
        free = free_by_geometry(reach, {k for k, here in enumerate(there) if here}, one)
        assert abs(degrees) == pytest.approx(min(map(abs, free)))
        assert any(degrees == pytest.approx(sector) for sector in free)


def test_direction_prefers_the_clockwise_of_two_as_near() -> None:
    reach = wide_hand(2, 3)
    empty = torch.zeros(1, 1, dtype=torch.int64)
    assert reach.direction_deg(empty, torch.tensor([4])).item() == pytest.approx(-15 / 29)


def test_direction_of_a_cell_that_is_not_accessible_is_nan() -> None:
    full = pack(torch.ones(2, 9, dtype=torch.bool))
    assert wide_hand(3, 3).direction_deg(full, torch.tensor([7, 0])).isnan().tolist() == [True, False]


@pytest.mark.parametrize(("rows", "cols"), [(3, 6), (8, 8), (10, 10)])
def test_batch_equals_rows_one_by_one(rows: int, cols: int) -> None:
    reach = wide_hand(rows, cols)
    occupied = random_boards(rows * cols, 64, seed=rows)
    board = pack(occupied)
    together = reach.accessible(occupied)
    assert torch.equal(together, torch.cat([reach.accessible(occupied[b : b + 1]) for b in range(64)]))
    for cell in range(0, rows * cols, 7):
        assert torch.equal(reach.cell_accessible(board, torch.full((64,), cell)), together[:, cell])
        sectors = reach.free_sectors(board, torch.full((64,), cell))
        assert torch.equal(sectors.any(-1), together[:, cell])


def test_a_cell_does_not_block_itself() -> None:
    alone = torch.eye(16, dtype=torch.bool)
    assert bool(wide_hand(4, 4).accessible(alone).diagonal().all())
    all_round = Reach(Layout.grid(4, 4, 0.12), 0.142, half_fan_deg=180.0, n_sectors=36)
    assert bool(all_round.free_sectors(pack(alone), torch.arange(16)).all())


def test_the_mirrored_board_is_mirrored() -> None:
    reach = wide_hand(5, 6)
    occupied = random_boards(30, 100, seed=8)
    assert reach.layout.mirror is not None
    assert torch.equal(
        reach.accessible(occupied[:, reach.layout.mirror]), reach.accessible(occupied)[:, reach.layout.mirror]
    )


def test_the_arms_yaw_limit_rules_corridors_out() -> None:
    layout = Layout.grid(3, 6, 0.12)
    reach = Reach(layout, 0.1, 30.0, 61, max_yaw_deg=10.0)
    for cell, (x, y) in enumerate(layout.cells):
        yaw = math.degrees(math.atan2(y, x))
        expected = [abs(yaw + degrees) <= 10.0 + 1e-7 for degrees in reach.sectors_deg.tolist()]
        assert reach.allowed_sectors[cell].tolist() == expected
    # A limit that no corridor of the outer cells keeps makes them inaccessible on an empty board.
    narrow = Reach(layout, 0.1, 5.0, 11, max_yaw_deg=10.0)
    accessible = narrow.accessible(torch.zeros(1, 18, dtype=torch.bool))[0]
    assert accessible[:6].tolist() == [False, False, True, True, False, False]


def test_the_arms_lateral_limit_rules_corridors_out() -> None:
    layout = Layout.grid(3, 6, 0.12)
    reach = Reach(layout, 0.1, 30.0, 61, staging_m=0.1, lateral_limit_m=0.15)
    for cell, (x, y) in enumerate(layout.cells):
        for sector, degrees in enumerate(reach.sectors_deg.tolist()):
            yaw = math.atan2(y, x) + math.radians(degrees)
            crossing = y - (x - (0.57 - 0.1)) * math.tan(yaw)
            assert bool(reach.allowed_sectors[cell, sector]) == (abs(crossing) <= 0.15), (cell, degrees)
    assert reach.direction_deg(torch.zeros(1, 1, dtype=torch.int64), torch.tensor([0])).item() > 0


def test_limits_change_what_is_accessible_and_nothing_else() -> None:
    layout = Layout.grid(4, 6, 0.12)
    occupied = random_boards(24, 200, seed=5)
    free = Reach(layout, **WIDE_HAND)  # type: ignore[arg-type]
    limited = Reach(layout, **WIDE_HAND, max_yaw_deg=12.0)  # type: ignore[arg-type]
    expected = torch.stack(
        [
            (free.free_sectors(pack(occupied), torch.full((200,), cell)) & limited.allowed_sectors[cell]).any(-1)
            for cell in range(24)
        ],
        -1,
    )
    assert torch.equal(limited.accessible(occupied), expected)
    assert not torch.equal(expected, free.accessible(occupied))
