"""Figures of rows: what is counted, and where the rays end."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from dore.report.frame import Source
from dore.report.row_plots import histogram, rays

NOTHING = pd.DataFrame()


def test_a_histogram_counts_each_series_and_stacks_them():
    rows = pd.DataFrame({"mm": [1.0, 1.5, 3.0, 9.0], "hit": [True, False, True, False]})
    series = [
        {"where": "hit", "label": "hit", "colour": "red"},
        {"where": "not hit", "label": "missed", "colour": "green"},
    ]
    line = {"from": "marks", "at": "limit", "text": "limit"}
    spec = {"from": "all", "of": "2 * mm", "bin": 4, "most": 8, "series": series, "x": "", "y": "", "line": line}
    sources = {"all": Source(rows), "marks": Source(pd.DataFrame({"limit": [5.0]}))}
    figure = histogram(spec, NOTHING, sources)
    assert figure is not None
    bars = [(bar.get_x(), bar.get_y(), bar.get_height()) for bar in figure.axes[0].patches]
    assert bars == [(0, 0, 1), (4, 0, 1), (0, 1, 1), (4, 1, 0)]
    assert figure.axes[0].lines[0].get_xdata() == [5, 5]


def test_rays_start_at_the_point_and_go_in_the_direction():
    rows = pd.DataFrame({"x": [1.0, 2.0], "angle": [0, 60], "name": ["a", "b"]})
    spec = {"from": "all", "x_of": "x", "y_of": "x - 1", "angle_of": "angle + 30", "length": 2, "name": "name"}
    figure = rays(
        {**spec, "x": "", "y": "", "series": [{"label": "all", "colour": "red"}]}, NOTHING, {"all": Source(rows)}
    )
    assert figure is not None
    segments = np.stack(figure.axes[0].collections[0].get_segments())
    assert segments[0] == pytest.approx(np.array([[1, 0], [1 + 3**0.5, 1]]))
    assert segments[1] == pytest.approx(np.array([[2, 1], [2, 3]]))
    assert [text.get_text() for text in figure.axes[0].texts] == ["a", "b"]
