"""A few keys with nonsense: each case ends in one line, or is accepted knowingly."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import pytest

from tests.trust.configs import Case, keys_of, run_case


@pytest.mark.parametrize(
    ("command", "key", "value", "outcome"),
    [
        ("train", "ipt.max_moves", "abc", "refused"),
        ("train", "ipt.max_moves", "-1", "refused"),
        ("train", "env.rewards", "-1", "refused"),
        ("train", "optimizer.lr", "1e308", "refused"),
        ("train", "layout", "5", "refused"),
        ("train", "target_update.tau", "null", "refused"),
        ("train", "training.max_minutes", "null", "accepted"),
        ("evaluate", "planners", "abc", "refused"),
        ("evaluate", "planners.learned.max_moves", "1000000000", "refused"),
        ("evaluate", "threads", "1000000000", "refused"),
        ("plan", "out", "[]", "refused"),
        ("execute", "limits.max_moves", "abc", "refused"),
        ("execute", "jitter_m", "0", "accepted"),
    ],
)
def test_nonsense_in_a_key(command: str, key: str, value: str, outcome: str, tmp_path: Path) -> None:
    import_module(f"dore.app.{command}")
    case = run_case(Case(command, key, value), tmp_path)
    assert case.outcome == outcome, case.message


def test_the_keys_of_a_command_are_found() -> None:
    keys = keys_of("evaluate")
    assert {"planners.exact.max_nodes", "layout.rows", "threads", "planners"} <= set(keys)
