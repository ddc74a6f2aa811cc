"""Where cells stand, and what layouts are refused."""

from __future__ import annotations

import json

import pytest
import torch

from dore.errors import InputError
from dore.world.layout import Layout

IRREGULAR = Layout(((0.5, 0.1), (0.5, -0.1), (0.68, 0.02)), 0.12)


def test_row_0_is_nearest_and_column_0_on_the_robots_left() -> None:
    layout = Layout.grid(3, 6, 0.12)
    assert (layout.n_cells, layout.grid_shape) == (18, (3, 6))
    # Front edge at 0.57 m, as the paper's table stands in all files.
    assert layout.front_m == pytest.approx(0.57)
    assert layout.cells[0] == pytest.approx((0.63, 0.30))
    assert layout.cells[5] == pytest.approx((0.63, -0.30))
    assert layout.cells[14] == pytest.approx((0.87, 0.06))
    assert layout.centres.dtype is torch.float64
    assert layout.centres.shape == (18, 2)


@pytest.mark.parametrize(("rows", "cols"), [(1, 1), (3, 6), (4, 5), (8, 8), (10, 10)])
def test_a_grids_centre_is_ahead_of_the_base_unless_its_front_is_given(rows: int, cols: int) -> None:
    x, y = Layout.grid(rows, cols, 0.1).centres.mean(0).tolist()
    assert (x, y) == pytest.approx((0.75, 0.0))
    assert Layout.grid(rows, cols, 0.1, front_m=0.4).front_m == pytest.approx(0.4)


def test_mirror_is_the_same_row_seen_from_the_other_side() -> None:
    layout = Layout.grid(2, 3, 0.12)
    assert layout.mirror is not None
    assert layout.mirror.tolist() == [2, 1, 0, 5, 4, 3]
    assert IRREGULAR.mirror is None
    symmetric = Layout(((0.5, 0.1), (0.7, 0.0), (0.5, -0.1)), 0.12)
    assert symmetric.mirror is not None
    assert symmetric.mirror.tolist() == [2, 1, 0]


@pytest.mark.parametrize("layout", [Layout.grid(3, 6, 0.12), Layout.grid(2, 2, 0.1, 0.3), IRREGULAR])
def test_a_layout_comes_back_from_json(layout: Layout) -> None:
    back = Layout.from_dict(json.loads(json.dumps(layout.to_dict())))
    torch.testing.assert_close(back.centres, layout.centres, rtol=0, atol=1e-9)
    assert (back.cell_m, back.grid_shape) == (layout.cell_m, layout.grid_shape)


@pytest.mark.parametrize(
    ("keys", "named"),
    [
        ({"rows": 0}, "rows"),
        ({"rows": True}, "rows"),
        ({"rows": 2.0}, "rows"),
        ({"cols": -1}, "cols"),
        ({"cols": "6"}, "cols"),
        ({"cell_m": 0.0}, "cell_m"),
        ({"cell_m": -0.12}, "cell_m"),
        ({"cell_m": float("nan")}, "cell_m"),
        ({"cell_m": float("inf")}, "cell_m"),
        ({"cell_m": None}, "cell_m"),
        ({"front_m": 0.0}, "front_m"),
        ({"front_m": float("inf")}, "front_m"),
        ({"rows": 20}, "rows"),
    ],
)
def test_bad_grids_are_one_line(keys: dict[str, object], named: str) -> None:
    with pytest.raises(InputError, match=rf"^layout\.{named}: [^\n]+$"):
        Layout.grid(**{"rows": 3, "cols": 6, "cell_m": 0.12, **keys})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "cells",
    [(), ((0.5, 0.0), (0.5, 0.0)), ((0.0, 0.1),), ((-0.5, 0.0),), ((0.5, float("nan")),)],
)
def test_bad_cells_are_one_line(cells: tuple[tuple[float, float], ...]) -> None:
    with pytest.raises(InputError, match=r"^layout[^\n]+$"):
        Layout(cells, 0.12)


@pytest.mark.parametrize(
    "data",
    [
        None,
        [],
        {},
        {"rows": 3, "cols": 6},
        {"rows": 3, "cols": 6, "cell_m": 0.12, "depth": 1},
        {"cells": [[0.5]], "cell_m": 0.12},
        {"cells": 7, "cell_m": 0.12},
        {"cells": [[0.5, 0.0]]},
    ],
)
def test_bad_descriptions_are_one_line(data: object) -> None:
    with pytest.raises(InputError, match=r"^layout[^\n]+$"):
        Layout.from_dict(data)


def test_cells_do_not_overlap() -> None:
    """Squares may touch at any angle, as on an arc, and no more."""
    Layout(((0.5, 0.0), (0.585, 0.085)), 0.12)
    with pytest.raises(InputError, match=r"^layout.cell_m: got 0.9, and the centres of cells 1 and 2 are 0.1 m apart"):
        Layout(((0.5, 0.0), (0.6, 0.0)), 0.9)
