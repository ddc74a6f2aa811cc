"""What all tests of learning share."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def no_curves(monkeypatch):
    """Runs are drawn no learning curve, which takes as long as a small run; tests/draw looks at curves."""
    monkeypatch.setattr("dore.app.session.draw_learning_curve", lambda metrics, picture: None)
