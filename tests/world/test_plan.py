"""The replay: it accepts exactly what the rules accept, and names the move and the reason otherwise."""

from __future__ import annotations

import dataclasses

import pytest
import torch

from dore.errors import InputError
from dore.world.board import bit, pack, unpack
from dore.world.layout import Layout
from dore.world.plan import Move, Plan, PlanError, Status, replay
from dore.world.problem import Problem, Scene
from dore.world.reach import Reach
from dore.world.rules import Failure, lift, retrievable, transition
from tests.drawings import PUBLISHED, WIDE_HAND, cells_of, scene_of, wide_hand

# The paper's Fig. 7: obstacles 16, 3, 9, 7, 13, 1, target 15; 16 to 18, 3 to 12, 9 to 17 (ids).
FIG_7 = Scene(Layout.grid(3, 6, 0.12), (15, 2, 8, 6, 12, 0), 14)
REACH = Reach(FIG_7.layout, **PUBLISHED)  # type: ignore[arg-type]


def directed(reach: Reach, scene: Scene, moves: list[tuple[int, int]], status: Status = Status.SOLVED) -> Plan:
    """A plan whose directions are those of the table, and the sector nearest 0 where the table has none."""

    nearest = reach.sectors_deg[reach.sectors_deg.abs().argmin()].item()

    def direction(standing: set[int], cell: int) -> float:
        board = pack(torch.tensor([[k in standing for k in range(reach.n_cells)]]))
        return reach.direction_deg(board, torch.tensor([cell])).nan_to_num(nearest).item()

    standing, done = set(scene.obstacles), []
    for pick, place in moves:
        others = (standing - {pick}) | {scene.target}
        done.append(Move(pick, place, direction(others, pick), direction(others, place)))
        standing = (standing - {pick}) | {place}
    final = direction(standing, scene.target) if status is Status.SOLVED else None
    return Plan(status, tuple(done), final, "test", 0.0)


FIG_7_PLAN = directed(REACH, FIG_7, [(15, 17), (2, 11), (8, 16)])


def test_the_papers_plan_replays() -> None:
    boards = replay(Problem(FIG_7, REACH), FIG_7_PLAN)
    assert boards == [
        {15, 2, 8, 6, 12, 0},
        {17, 2, 8, 6, 12, 0},
        {17, 11, 8, 6, 12, 0},
        {17, 11, 16, 6, 12, 0},
    ]


def test_a_plan_without_moves_replays_where_the_target_is_free() -> None:
    scene = Scene(FIG_7.layout, (0,), 14)
    assert replay(Problem(scene, REACH), directed(REACH, scene, [])) == [{0}]


def altered(number: int, **changes: float) -> Plan:
    """The paper's plan with one move changed; `number` counts from 1."""
    moves = list(FIG_7_PLAN.moves)
    moves[number - 1] = dataclasses.replace(moves[number - 1], **changes)  # type: ignore[arg-type]
    return dataclasses.replace(FIG_7_PLAN, moves=tuple(moves))


@pytest.mark.parametrize(
    ("plan", "why"),
    [
        (altered(2, pick=3), r"move 2 \(4 to 12\): no obstacle on cell 4"),
        (altered(1, pick=14), r"move 1 \(15 to 18\): no obstacle on cell 15"),
        (altered(1, pick=99), r"move 1 \(100 to 18\): no obstacle on cell 100"),
        (altered(1, place=14), r"move 1 \(16 to 15\): cell 15 is not empty"),
        (altered(3, place=11), r"move 3 \(9 to 12\): cell 12 is not empty"),
        (altered(1, place=18), r"move 1 \(16 to 19\): place id 19, want 1 to 18"),
        (altered(1, place=-1), r"move 1 \(16 to 0\): place id 0, want 1 to 18"),
        (
            altered(1, place=15, place_direction_deg=FIG_7_PLAN.moves[0].pick_direction_deg),
            r"move 1 \(16 to 16\): goes back to an earlier board",
        ),
        (altered(1, pick_direction_deg=31.0), r"move 1 \(16 to 18\): pick direction 31 deg, want within \+-30"),
        (
            altered(1, pick_direction_deg=float("nan")),
            r"move 1 \(16 to 18\): pick: no free approach direction",
        ),
        (altered(2, place_direction_deg=-40.0), r"move 2 \(3 to 12\): place direction -40 deg"),
        (
            altered(1, pick_direction_deg=-20.0),
            r"move 1 .*: pick corridor at -20 deg is blocked by the object on cell 3",
        ),
        (altered(1, place=13), r"move 1 .*: place corridor at .* deg is blocked by the object on cell"),
        (
            dataclasses.replace(FIG_7_PLAN, moves=FIG_7_PLAN.moves[:2]),
            "^target corridor at .* deg is blocked by .* cell 9$",
        ),
        (dataclasses.replace(FIG_7_PLAN, target_direction_deg=-31.0), "^target direction -31 deg"),
    ],
)
def test_a_bad_plan_is_refused_with_the_move_and_the_reason(plan: Plan, why: str) -> None:
    with pytest.raises(PlanError, match=why) as error:
        replay(Problem(FIG_7, REACH), plan)
    assert "\n" not in str(error.value)


def test_going_back_to_any_earlier_board_is_refused() -> None:
    scene = Scene(FIG_7.layout, (0,), 14)
    for loop in ([(0, 1), (1, 0)], [(0, 1), (1, 2), (2, 1)]):
        with pytest.raises(PlanError, match=f"move {len(loop)} .*: goes back to an earlier board"):
            replay(Problem(scene, REACH), directed(REACH, scene, loop, Status.GAVE_UP))


def test_the_target_blocks_corridors() -> None:
    scene = scene_of("""
        o . .
        T . .
        . . .
    """)
    reach = Reach(scene.layout, clearance_m=0.11, half_fan_deg=5.0, n_sectors=11)
    with pytest.raises(PlanError, match=r"pick corridor .* blocked by the object on cell 4"):
        replay(Problem(scene, reach), directed(reach, scene, [(6, 2)], Status.GAVE_UP))


def test_corridors_that_the_arm_cannot_follow_are_refused() -> None:
    scene = Scene(FIG_7.layout, (0,), 14)
    yaw = Reach(FIG_7.layout, **PUBLISHED, max_yaw_deg=10.0)  # type: ignore[arg-type]
    lateral = Reach(FIG_7.layout, **PUBLISHED, staging_m=0.1, lateral_limit_m=0.1)  # type: ignore[arg-type]
    plan = Plan(Status.GAVE_UP, (Move(0, 3, 0.0, 0.0),), None, "test", 0.0)
    replay(Problem(scene, REACH), plan)
    with pytest.raises(PlanError, match=r"move 1 \(1 to 4\): pick corridor heads 25.5 deg, want within \+-10"):
        replay(Problem(scene, yaw), plan)
    with pytest.raises(PlanError, match=r"pick corridor crosses the staging line at y = 0.224 m, want within \+-0.1"):
        replay(Problem(scene, lateral), plan)


@pytest.mark.parametrize(
    "reach",
    [
        wide_hand(3, 5),
        Reach(Layout.grid(4, 5, 0.12), **PUBLISHED, staging_m=0.05, lateral_limit_m=0.2),  # type: ignore[arg-type]
        Reach(Layout.grid(9, 9, 0.09), **WIDE_HAND, max_yaw_deg=20.0),  # type: ignore[arg-type]
    ],
)
def test_the_replay_agrees_with_the_rules(reach: Reach) -> None:
    """Move by move on random boards: accepted by one is accepted by the other, with the table's directions."""
    generator = torch.Generator().manual_seed(reach.n_cells)
    n, g = 400, reach.n_cells
    occupied = torch.rand(n, g, generator=generator) < 0.7 * torch.rand(n, 1, generator=generator)
    target = torch.randint(g, (n,), generator=generator)
    occupied[torch.arange(n), target] = False
    pick = (occupied + 0.3 * torch.rand(n, g, generator=generator)).argmax(-1)
    place = torch.randint(g, (n,), generator=generator)
    board = pack(occupied)
    outcome = transition(reach, board, target, board[:, None], pick, place)
    assert 20 < int((outcome.failure == 0).sum()) < n - 20
    free = retrievable(reach, outcome.board, target)
    for row in range(n):
        scene = Scene(reach.layout, tuple(occupied[row].nonzero().squeeze(-1).tolist()), int(target[row]))
        move = [(int(pick[row]), int(place[row]))]
        if int(outcome.failure[row]) == Failure.NONE:
            boards = replay(Problem(scene, reach), directed(reach, scene, move, Status.GAVE_UP))
            assert boards[-1] == set(unpack(outcome.board[row], g).nonzero().squeeze(-1).tolist())
            solved = directed(reach, scene, move)
            if bool(free[row]):
                replay(Problem(scene, reach), solved)
            else:
                with pytest.raises(PlanError, match=r"^target"):
                    replay(Problem(scene, reach), solved)
        else:
            with pytest.raises(PlanError, match=r"^move 1 "):
                replay(Problem(scene, reach), directed(reach, scene, move, Status.GAVE_UP))


def test_every_sector_of_the_table_replays_or_not_alike() -> None:
    """Not only the sector nearest 0: each (cell, sector) that the table leaves free is free for the replay."""
    reach = wide_hand(3, 5)
    generator = torch.Generator().manual_seed(0)
    seen = {True: 0, False: 0}
    for _ in range(40):
        occupied = torch.rand(1, 15, generator=generator) < 0.3
        cell = torch.randint(15, (1,), generator=generator)
        board = lift(pack(occupied), cell)
        scene = Scene(reach.layout, tuple(unpack(board, 15)[0].nonzero().squeeze(-1).tolist()), int(cell))
        sectors = reach.free_sectors(board | bit(cell, 1), cell)[0].tolist()
        for degrees, free in zip(reach.sectors_deg.tolist(), sectors, strict=True):
            plan = Plan(Status.SOLVED, (), degrees, "test", 0.0)
            seen[free] += 1
            if free:
                replay(Problem(scene, reach), plan)
            else:
                with pytest.raises(PlanError, match=r"^target corridor"):
                    replay(Problem(scene, reach), plan)
    assert min(seen.values()) > 100


@pytest.mark.parametrize(
    ("obstacles", "target", "why"),
    [
        ((0, 18), 3, "scene.obstacles: id 19, want 1 to 18"),
        ((-1,), 3, "scene.obstacles: id 0, want 1 to 18"),
        ((0,), 18, "scene.target: id 19, want 1 to 18"),
        ((4, 2, 4), 3, "scene.obstacles: two objects on cell 5"),
        ((3, 5), 3, "scene.target: cell 4 holds an obstacle"),
    ],
)
def test_bad_scenes_are_one_line(obstacles: tuple[int, ...], target: int, why: str) -> None:
    with pytest.raises(InputError, match=f"^{why}[^\n]*$"):
        Scene(FIG_7.layout, obstacles, target)


def test_only_a_solved_plan_has_a_target_direction() -> None:
    with pytest.raises(InputError, match="status gave_up"):
        Plan(Status.GAVE_UP, (), 0.0, "test", 0.0)
    with pytest.raises(InputError, match="status solved"):
        Plan(Status.SOLVED, (), None, "test", 0.0)


def test_drawings_are_read_from_behind_the_robot() -> None:
    assert cells_of("a . b\n c . .", "abc") == [0, 3, 5]
