"""Q-networks: shapes, what they refuse, and that each cell's own value is its own in the convolutional one."""

from __future__ import annotations

from functools import partial

import pytest
import torch

from dore.errors import InputError
from dore.learn.agents.common import _network_of
from dore.learn.networks import MLP, ConvNet
from dore.world.layout import Layout
from dore.world.reach import Reach
from tests.drawings import WIDE_HAND, wide_hand

GRID = wide_hand(3, 4)
MLPS = partial(MLP, widths=[16, 8])
CONVS = partial(ConvNet, channels=8, blocks=1)


@pytest.mark.parametrize("network", [MLPS, CONVS])
def test_one_output_a_head(network):
    made = network(reach=GRID, n_planes=3, n_outputs=(5, 12))
    slots, cells = made(torch.rand(7, 3, 12))
    assert slots.shape == (7, 5)
    assert cells.shape == (7, 12)


@pytest.mark.parametrize("network", [MLPS, CONVS])
def test_rows_do_not_see_each_other(network):
    made = network(reach=GRID, n_planes=2, n_outputs=(12,))
    planes = torch.rand(6, 2, 12)
    (together,) = made(planes)
    alone = torch.cat([made(planes[row : row + 1])[0] for row in range(6)])
    torch.testing.assert_close(together, alone)


def test_swish():
    assert any(isinstance(layer, torch.nn.SiLU) for layer in MLPS(reach=GRID, n_planes=1, n_outputs=(1,)).trunk)


def test_conv_knows_where_a_cell_is():
    """Reach depends on where the robot is, so the same neighbourhood may be worth something else elsewhere."""
    (values,) = CONVS(reach=wide_hand(9, 9, 0.1), n_planes=1, n_outputs=(81,))(torch.zeros(1, 1, 81))
    assert values.view(9, 9)[3:6, 3:6].std() > 0


def test_conv_refuses_an_irregular_layout():
    irregular = Layout(cells=((0.5, 0.0), (0.7, 0.1)), cell_m=0.1)
    with pytest.raises(InputError, match="irregular; want mlp"):
        CONVS(reach=Reach(irregular, **WIDE_HAND), n_planes=1, n_outputs=(2,))


@pytest.mark.parametrize(
    ("network", "says"),
    [
        (partial(MLP, widths=[]), r"network.widths: got \[\]"),
        (partial(MLP, widths=[4, 0]), "network.widths: got 0"),
        (partial(ConvNet, channels=0, blocks=1), "network.channels: got 0"),
        (partial(ConvNet, channels=4, blocks="2"), "network.blocks: got '2'"),
    ],
)
def test_bad_sizes(network, says):
    with pytest.raises(InputError, match=says):
        network(reach=GRID, n_planes=1, n_outputs=(12,))


class Alone(torch.nn.Module):
    """Returns one tensor instead of a tuple."""

    def __init__(self, reach, n_planes, n_outputs):
        super().__init__()
        self.layer = torch.nn.Linear(n_planes * reach.n_cells, n_outputs[0])

    def forward(self, planes):
        return self.layer(planes.flatten(1))


class Narrow(Alone):
    """Has one output too few."""

    def forward(self, planes):
        return (super().forward(planes)[:, 1:],)


class Deep(Alone):
    """Cannot take these planes."""

    def forward(self, planes):
        return (self.layer(planes),)


@pytest.mark.parametrize(
    ("network", "says"),
    [
        (Alone, r"network: Alone returns Tensor of planes \[1, 3, 12\], want a tuple of shapes \[\(1, 12\)\]"),
        (Narrow, r"network: Narrow returns \[\(1, 11\)\]"),
        (Deep, r"network: Deep cannot take planes \[1, 3, 12\]"),
    ],
)
def test_a_network_of_other_outputs_is_refused_when_it_is_made(network, says):
    with pytest.raises(InputError, match=says):
        _network_of(network, reach=GRID, n_planes=3, n_outputs=(12,))
