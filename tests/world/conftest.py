"""A good plan file, for the tests of files."""

from __future__ import annotations

from pathlib import Path

import pytest

from dore.world.files import write_plan
from dore.world.plan import PlanFile
from dore.world.problem import Problem
from tests.world.test_plan import FIG_7, FIG_7_PLAN, REACH

FILE = PlanFile(Problem(FIG_7, REACH), FIG_7_PLAN)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A good plan file."""
    write_plan(tmp_path / "plan.json", FILE)
    return tmp_path / "plan.json"
