"""How far long work is, where there is no terminal."""

from __future__ import annotations

import pytest

from dore.report import progress


def test_a_pipe_gets_lines_and_no_bar(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    now = iter(range(0, 1000, 12))
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(now))
    with progress.ProgressBar(total=2000, initial=1000, unit="plan") as bar:
        bar.set_description("exact")
        for _ in range(5):
            bar.update(100)
    said = capsys.readouterr()
    assert said.err == "exact: 1,300 of 2,000 plans in 36 s\n"
    assert said.out == ""
