"""The planners' benchmark, tiny: every part fills its table, and what is asked for wrongly is said."""

from __future__ import annotations

import pytest
from hydra.core.global_hydra import GlobalHydra

from scripts import bench_planners


def test_the_page(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(bench_planners, "process_seconds", lambda *command: 1.25)
    GlobalHydra.instance().clear()
    page = tmp_path / "planners.md"
    bench_planners.main(["--limit", "2", "--out", str(page)])
    text = page.read_text()
    assert text in capsys.readouterr().out + "\n"
    for words in (
        "2 test instances",
        "| graph_search |",
        "| ratio |",
        "The paper's ratio of the means is 3.8",
        "| straight_line |",
        "| moves / optimum |",
        "| guided | 1.25 | 1.25 |",
        "load",
    ):
        assert words in text
    assert text.count("\n## ") == 5


@pytest.mark.parametrize(
    ("arguments", "says"),
    [(["--parts", "a,z"], "--parts: got z, want some of a, b"), (["--limit", "0"], "--limit: got 0")],
)
def test_what_is_asked_for_wrongly(arguments, says, capsys):
    with pytest.raises(SystemExit) as ended:
        bench_planners.main(arguments)
    assert ended.value.code == 2
    assert says in capsys.readouterr().err
