"""Instance sets: seeded, unique, split for good, and checked."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from dore.errors import InputError
from dore.world.board import count, pack, unpack
from dore.world.generator import SPLITS, Difficulty, FreshInstances, split_share
from dore.world.instances import FixedInstances, InstanceSet
from dore.world.layout import Layout
from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.rules import has_move, retrievable
from tests.drawings import wide_hand

REACH = wide_hand(4, 5)
SOME = Difficulty(3, 7)


def keys(instances: InstanceSet) -> list[tuple[int, ...]]:
    return [(*board, target) for board, target in zip(instances.board.tolist(), instances.target.tolist(), strict=True)]


@pytest.mark.parametrize("reach", [REACH, wide_hand(9, 9)])
def test_a_seed_makes_one_set_of_different_blocked_instances(reach: Reach) -> None:
    instances = InstanceSet.generate(reach, 500, SOME, "train", seed=3)
    assert len(set(keys(instances))) == len(instances) == 500
    assert keys(InstanceSet.generate(reach, 500, SOME, "train", seed=3)) == keys(instances)
    assert keys(InstanceSet.generate(reach, 500, SOME, "train", seed=4)) != keys(instances)
    assert not bool(retrievable(reach, instances.board, instances.target).any())
    assert bool(has_move(reach, instances.board, instances.target).all())
    assert set(count(instances.board).tolist()) == {3, 4, 5, 6, 7}
    occupied = unpack(instances.board, reach.n_cells)
    assert not bool(occupied.gather(-1, instances.target[:, None]).any())


def test_a_set_holds_problems() -> None:
    instances = InstanceSet.generate(REACH, 20, SOME, "test", seed=0)
    for number, problem in enumerate(instances):
        batch = Batch.of(problem)
        assert torch.equal(batch.board, instances.board[number : number + 1])
        assert torch.equal(batch.target, instances.target[number : number + 1])


def mirrored(reach: Reach, board: torch.Tensor) -> torch.Tensor:
    assert reach.layout.mirror is not None
    return pack(unpack(board, reach.n_cells)[:, reach.layout.mirror])


def test_no_board_nor_its_mirror_image_is_in_two_splits() -> None:
    reach = wide_hand(3, 4)
    boards: dict[str, set[tuple[int, ...]]] = {}
    for split in SPLITS:
        drawn = FreshInstances(reach, Difficulty(2, 6), split, seed=0).draw(20000).board
        boards[split] = {tuple(words) for part in (drawn, mirrored(reach, drawn)) for words in part.tolist()}
    assert all(len(found) > 50 for found in boards.values())
    assert boards["train"].isdisjoint(boards["validation"])
    assert boards["train"].isdisjoint(boards["test"])
    assert boards["validation"].isdisjoint(boards["test"])


def test_splits_take_their_shares_of_all_boards() -> None:
    generator = torch.Generator().manual_seed(0)
    for reach in (REACH, wide_hand(9, 9)):
        board = pack(torch.rand(40000, reach.n_cells, generator=generator) < 0.4)
        share = split_share(board, reach)
        assert torch.equal(share, split_share(mirrored(reach, board), reach))
        for low, high in SPLITS.values():
            inside = ((share >= low) & (share < high)).double().mean().item()
            assert inside == pytest.approx(high - low, abs=0.012)


@pytest.mark.parametrize(
    ("board", "target", "why"),
    [
        ([[1 << 20]], [0], "number 1 has an obstacle off the board"),
        ([[-1]], [0], "number 1 has an obstacle off the board"),
        ([[2]], [20], "number 1 has a target off the board"),
        ([[2]], [-1], "number 1 has a target off the board"),
        ([[2]], [1], "number 1 has the target among the obstacles"),
        ([[1 << 19]], [0], "number 1 has nothing to rearrange"),
        ([[2, 0]], [0], r"got boards \[1, 2\] and targets \[1\], want \[N, 1\] and \[N\]"),
        ([[2], [4]], [0], r"got boards \[2, 1\] and targets \[1\], want \[N, 1\] and \[N\]"),
        ([[6], [2], [6]], [0, 0, 0], "number 3 has the board and the target of an earlier one"),
    ],
)
def test_bad_instances_are_refused(board: list[list[int]], target: list[int], why: str) -> None:
    with pytest.raises(InputError, match=why):
        InstanceSet(REACH, torch.tensor(board), torch.tensor(target))


def test_targets_of_another_type_are_refused() -> None:
    instances = InstanceSet.generate(REACH, 5, SOME, "test", seed=0)
    with pytest.raises(InputError, match="number 5 has a target off the board"):
        InstanceSet(REACH, instances.board, torch.cat([instances.target[:-1], torch.tensor([255])]))
    with pytest.raises(InputError, match=r"instances: got torch\.float32, want integers"):
        InstanceSet(REACH, instances.board, instances.target.float())


def test_a_set_takes_integers_of_any_width_and_shares_no_memory() -> None:
    made = InstanceSet.generate(REACH, 5, SOME, "test", seed=0)
    before = keys(made)
    board, target = made.board.numpy().astype("uint32"), made.target.numpy().astype("int8")
    taken = InstanceSet(REACH, board, target)  # type: ignore[arg-type]
    assert keys(taken) == before
    board[:], target[:] = 0, 0
    for handed_out in (taken.batch(), taken.batch(slice(3)), taken.batch(torch.tensor([1, 2]))):
        handed_out.board.zero_()
        handed_out.target.zero_()
    assert keys(taken) == before


@pytest.mark.parametrize("seed", [np.int64(3), np.uint8(3), torch.tensor(3)])
def test_a_seed_of_numpy_or_torch_is_that_seed(seed: object) -> None:
    want = keys(InstanceSet.generate(REACH, 20, SOME, "test", seed=3))
    assert keys(InstanceSet.generate(REACH, 20, SOME, "test", seed=seed)) == want  # type: ignore[arg-type]
    source = FreshInstances(REACH, SOME, "train", 0)
    source.seed(seed)  # type: ignore[arg-type]
    assert torch.equal(source.draw(5).board, FreshInstances(REACH, SOME, "train", 3).draw(5).board)
    for bad in (-1, 2.5, "3"):
        with pytest.raises(InputError, match=r"^instances\.seed: got"):
            FixedInstances(InstanceSet.generate(REACH, 5, SOME, "test", seed=0), bad)  # type: ignore[arg-type]


@pytest.mark.parametrize("reach", [REACH, wide_hand(9, 9)])
def test_a_fresh_source_continues_where_its_state_was_taken(reach: Reach) -> None:
    source = FreshInstances(reach, SOME, "train", seed=5)
    source.draw(123)
    state = source.state_dict()
    expected = [source.draw(n) for n in (1, 700, 9000)]
    other = FreshInstances(reach, SOME, "train", seed=99)
    other.draw(5)
    other.load_state_dict(state)
    for batch in expected:
        again = other.draw(len(batch.target))
        assert torch.equal(again.board, batch.board)
        assert torch.equal(again.target, batch.target)


def test_a_fixed_source_continues_where_its_state_was_taken() -> None:
    instances = InstanceSet.generate(REACH, 50, SOME, "train", seed=0)
    source = FixedInstances(instances, seed=5)
    source.draw(10)
    state = source.state_dict()
    expected = source.draw(100)
    other = FixedInstances(instances, seed=6)
    assert not torch.equal(other.draw(100).board, expected.board)
    other.load_state_dict(state)
    assert torch.equal(other.draw(100).board, expected.board)
    assert set(expected.board[:, 0].tolist()) <= set(instances.board[:, 0].tolist())


def test_draws_do_not_depend_on_how_many_are_asked_for_at_a_time() -> None:
    one, other = (FreshInstances(REACH, SOME, "test", seed=1) for _ in range(2))
    together = one.draw(300)
    parts = torch.cat([other.draw(n).board for n in (1, 99, 200)])
    assert torch.equal(parts, together.board)


def test_sources_leave_the_global_generator_alone() -> None:
    before = torch.get_rng_state()
    FreshInstances(REACH, SOME, "train", seed=1).draw(10)
    InstanceSet.generate(REACH, 10, SOME, "train", seed=1)
    assert torch.equal(torch.get_rng_state(), before)


@pytest.mark.parametrize(("low", "high"), [(0, 3), (4, 3), (1.5, 3), (-1, 3), (True, 3)])
def test_bad_difficulties_are_one_line(low: int, high: int) -> None:
    with pytest.raises(InputError, match=r"^instances.min_obstacles: [^\n]+$"):
        Difficulty(low, high)


def test_what_cannot_be_generated_is_one_line() -> None:
    with pytest.raises(InputError, match="do not fit on 20 cells"):
        FreshInstances(REACH, Difficulty(3, 20), "train", seed=0)
    with pytest.raises(InputError, match="want one of train, validation, test"):
        FreshInstances(REACH, SOME, "exam", seed=0)
    with pytest.raises(InputError, match="different ones of the test split, there are"):
        InstanceSet.generate(wide_hand(2, 3), 10**5, Difficulty(1, 2), "test", seed=0)
    with pytest.raises(InputError, match="no board of the train split blocks its target"):
        FreshInstances(wide_hand(1, 2), Difficulty(1, 1), "train", seed=0).draw(1)


def test_lists_are_no_tensors() -> None:
    reach = Reach(Layout.grid(3, 3, 0.09), 0.09, 60, 21)
    with pytest.raises(InputError, match=r"instances: got \[\[3\]\], want an array of integers"):
        InstanceSet(reach, [[3]], [4])  # type: ignore[arg-type]
