"""The planners' benchmark, tiny: the page has a table of each part, and what is asked for wrongly is said."""

from __future__ import annotations

from functools import partial

import pytest
from hydra.core.global_hydra import GlobalHydra

from dore.report import results
from scripts import bench_planners
from scripts.program import run
from tests.report import fakes

EARLIER = """
import json, sys
for line in sys.stdin:
    targets = [target for _, targets in json.loads(line)[-1] for target in targets]
    print(json.dumps([{"old_ms": 1234.5, "old_status": "solved", "old_moves": 99} for _ in targets]), flush=True)
"""


def small(part):
    """The same part with the first set alone."""
    return partial(part.func, part.args[0][:1], *part.args[1:]) if isinstance(part, partial) else part


@pytest.mark.slow
def test_the_page(tmp_path, monkeypatch):
    monkeypatch.setattr(bench_planners, "OLD", EARLIER)
    monkeypatch.setattr(bench_planners, "PLAN", "pass  # {}")
    parts = {name: small(part) for name, part in bench_planners.PARTS.items()}
    monkeypatch.setattr(bench_planners, "PARTS", parts)
    monkeypatch.setattr(bench_planners, "ALL", [bench_planners.dense(3, 6, 50)])
    GlobalHydra.instance().clear()
    assert run(bench_planners.main, bench_planners.Options, [f"out={tmp_path}", "limit=2", "commit=HEAD"]) == 0
    text = results.write_page(fakes.study("planners"), "planners", tmp_path, tmp_path / "p").read_text(encoding="utf-8")
    for words in (
        "| 6 x 6, 3-8 (wide_hand) | 2 |",
        "| search and replay |",
        "| 8 x 8, 19 (wide_hand) | 2 | 100.0 % |",
        "| 12 x 12, 43 (wide_hand) | 2 |",
        "| 6 x 6, 5 (wide_hand) | 2 |",
        "| 6 x 6, 3-8 (wide_hand) | 2 | 2 | 2 | 1234.50 |",
        "| all | 2 | 2 | 2 | 0 | 0 |",
        "| now / earlier |",
    ):
        assert words in text, words
    assert text.count("\n## ") == 7
    assert "nan" not in text


@pytest.mark.parametrize(
    ("word", "says"),
    [
        ("parts=[latency,z]", "parts: got z, want some of latency, decided"),
        ("parts=a", "parts: "),
        ("limit=0", "limit: got 0"),
        ("limit=few", "limit: Value 'few' of type 'str' could not be converted to Integer; the options are out, parts"),
        ("size=3", "size: Key 'size' not in 'Options'; the options are out, parts"),
        ("limit=[", "limit=[: while parsing"),
    ],
)
def test_what_is_asked_for_wrongly_is_one_line(word, says, tmp_path, capsys):
    assert run(bench_planners.main, bench_planners.Options, [f"out={tmp_path}", word]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("bench_planners: ")
    assert says in line


def test_help_names_the_options(capsys):
    assert run(bench_planners.main, bench_planners.Options, ["--help"]) == 0
    said = capsys.readouterr().out
    assert "in turn with that of an earlier commit" in said
    assert "limit: 10000" in said
