"""The planners' benchmark, tiny: the page has a table of each part, and what is asked for wrongly is said."""

from __future__ import annotations

import pytest
from hydra.core.global_hydra import GlobalHydra

from dore.report import results
from scripts import bench_planners
from scripts.program import run
from tests.report import fakes


def test_the_page(tmp_path, monkeypatch):
    monkeypatch.setattr(bench_planners, "process_seconds", lambda *command: 1.25)
    GlobalHydra.instance().clear()
    assert run(bench_planners.main, bench_planners.Options, [f"out={tmp_path}", "limit=2", "learned_model="]) == 0
    text = results.write_page(fakes.study("planners"), "planners", tmp_path, tmp_path / "p").read_text(encoding="utf-8")
    for words in (
        "13 obstacles, 2 test instances",
        "9 obstacles, 2 test instances",
        "3-9 obstacles, 2 test instances",
        "How they ended: 2 solved, 0 unsolvable",
        "| graph_search |",
        "| ratio |",
        "The paper's ratio of the means is 3.8",
        "| straight_line |",
        "| moves / optimum |",
        "| 0 of 2 |",
        "| guided | 1.25 | 1.25 |",
    ):
        assert words in text, words
    assert text.count("\n## ") == 5
    assert "nan" not in text


@pytest.mark.parametrize(
    ("word", "says"),
    [
        ("parts=[a,z]", "parts: got z, want some of a, b"),
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
    assert "taking turns" in said
    assert "limit: 10000" in said
