"""What a reach refuses, and that its parameters come back from files."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from dore.errors import InputError
from dore.world.layout import Layout
from dore.world.reach import Reach
from tests.drawings import WIDE_HAND, wide_hand

REFERENCE = json.loads((Path(__file__).parents[1] / "data/vfh_reference.json").read_text())["cases"]


@pytest.mark.parametrize(
    ("keys", "named"),
    [
        ({"clearance_m": 0.0}, "clearance_m"),
        ({"clearance_m": -0.1}, "clearance_m"),
        ({"clearance_m": float("nan")}, "clearance_m"),
        ({"clearance_m": "0.1"}, "clearance_m"),
        ({"half_fan_deg": 0.0}, "half_fan_deg"),
        ({"half_fan_deg": 181.0}, "half_fan_deg"),
        ({"n_sectors": 1}, "n_sectors"),
        ({"n_sectors": 2.5}, "n_sectors"),
        ({"n_sectors": True}, "n_sectors"),
        ({"staging_m": -0.1}, "staging_m"),
        ({"lateral_limit_m": 0.0}, "lateral_limit_m"),
        ({"max_yaw_deg": 181.0}, "max_yaw_deg"),
        ({"max_yaw_deg": float("inf")}, "max_yaw_deg"),
    ],
)
def test_bad_values_are_one_line(keys: dict[str, object], named: str) -> None:
    with pytest.raises(InputError, match=f"^reach.{named}: got [^\n]+$"):
        Reach(Layout.grid(2, 2, 0.12), **{**WIDE_HAND, **keys})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "occupied",
    [torch.zeros(1, 5, dtype=torch.bool), torch.zeros(4, dtype=torch.bool), torch.zeros(1, 4)],
)
def test_boards_of_another_shape_are_refused(occupied: torch.Tensor) -> None:
    with pytest.raises(InputError, match=r"want Bool\[B, 4\]"):
        wide_hand(2, 2).accessible(occupied)


def test_parameters_come_back_from_files() -> None:
    layout = Layout.grid(3, 6, 0.12)
    for reach in (wide_hand(3, 6), Reach(layout, 0.1, 30.0, 60, 0.05, 0.2, 40.0)):
        back = Reach(layout, **reach.to_dict())
        assert back.to_dict() == reach.to_dict()
        assert torch.equal(back.allowed_sectors, reach.allowed_sectors)


def test_boards_of_32_bits_and_unknown_devices_are_refused() -> None:
    reach = wide_hand(6, 6)
    with pytest.raises(InputError, match=r"^board: got torch.int32\[3, 1\], want Int64\[B, 1\]$"):
        reach.accessible_packed(torch.zeros(3, 1, dtype=torch.int32))
    with pytest.raises(InputError, match=r"^device: got 'nope', want cpu, cuda or cuda:N$"):
        reach.to("nope")
