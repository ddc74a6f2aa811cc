"""What networks see, mirror images, and the slots of the single DQN."""

from __future__ import annotations

import torch

from dore.learn.features import encode, n_planes, slot_of, slots
from dore.world.board import pack, unpack
from dore.world.mirror import mirrored_board, mirrored_cell
from dore.world.rules import accessibility
from tests.drawings import wide_hand
from tests.worlds import make_env


def test_the_papers_example_state():
    """Fig. 2: obstacles on 4, 7 and 14, the target on 18 of 5 x 5 (ids from 1)."""
    occupied = torch.zeros(1, 25, dtype=torch.bool)
    occupied[0, [3, 6, 13]] = True
    state = encode(wide_hand(5, 5), pack(occupied), torch.tensor([17]), None, "state")
    want = torch.zeros(25)
    want[[3, 6, 13]], want[17] = 1, 2
    assert torch.equal(state[0, 0], want)
    planes = encode(wide_hand(5, 5), pack(occupied), torch.tensor([17]), occupied, "planes")
    assert torch.equal(planes[0, 0], (want == 1).float())
    assert torch.equal(planes[0, 1], (want == 2).float())
    assert torch.equal(planes[0, 2], occupied[0].float())
    assert planes.shape[1] == n_planes("planes", with_mask=True)
    assert state.shape[1] == n_planes("state", with_mask=False)


def test_slots_are_the_obstacles_ascending():
    """Section 5.1: with O = {4, 7, 14}, a_p = 2 is the obstacle on 7."""
    occupied = torch.zeros(2, 25, dtype=torch.bool)
    occupied[0, [13, 3, 6]] = True
    occupied[1, [0, 24, 1, 2, 3]] = True
    cells, there = slots(pack(occupied), 4, 25)
    assert cells.tolist() == [[3, 6, 13, 0], [0, 1, 2, 3]]
    assert there.tolist() == [[True, True, True, False], [True] * 4]
    assert slot_of(pack(occupied), torch.tensor([6, 24]), 25).tolist() == [1, 4]


def test_a_mirrored_board_is_the_same_problem():
    reach = wide_hand(4, 5)
    env = make_env(reach, 64, 8)
    shown = env.reset()
    board, target = shown["board"], shown["target"]
    mirror = reach.layout.mirror
    other, other_target = mirrored_board(board, reach), mirrored_cell(target, reach)
    assert torch.equal(unpack(other, 20), unpack(board, 20)[:, mirror])
    assert torch.equal(mirrored_board(other, reach), board)
    ours, theirs = accessibility(reach, other, other_target), accessibility(reach, board, target)
    assert torch.equal(ours.pick, theirs.pick[:, mirror])
    assert torch.equal(ours.place, theirs.place[:, mirror])
