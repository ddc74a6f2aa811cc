"""The planners' benchmark, tiny: the page has a table of each part, and what is asked for wrongly is said."""

from __future__ import annotations

import pytest
from hydra.core.global_hydra import GlobalHydra

from dore.report import results
from scripts import bench_planners
from tests.report import fakes


def test_the_page(tmp_path, monkeypatch):
    monkeypatch.setattr(bench_planners, "process_seconds", lambda *command: 1.25)
    GlobalHydra.instance().clear()
    bench_planners.main([str(tmp_path), "--limit", "2", "--learned-model="])
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
    ("arguments", "says"),
    [(["--parts", "a,z"], "--parts: got z, want some of a, b"), (["--limit", "0"], "--limit: got 0")],
)
def test_what_is_asked_for_wrongly(arguments, says, capsys):
    with pytest.raises(SystemExit) as ended:
        bench_planners.main(["out", *arguments])
    assert ended.value.code == 2
    assert says in capsys.readouterr().err
