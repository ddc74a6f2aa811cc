"""What all tests of learning share."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def no_curves(monkeypatch):
    """The learning curves of runs are empty files: to draw one takes as long as a small run; see tests/draw."""
    monkeypatch.setattr("dore.app.session.draw_learning_curve", lambda metrics, picture: Path(picture).touch())
