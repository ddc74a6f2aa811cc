"""Marks tests that take pictures: skipped only where nothing can render, and the reason says what to install."""

from __future__ import annotations

import pytest

from dore.sim.scene.agent import NO_DRIVER, render_backend

needs_vulkan = pytest.mark.skipif(render_backend() == "none", reason=NO_DRIVER)
