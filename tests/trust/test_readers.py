"""A few hundred mutated files: one line for each that is refused; nonsense is never accepted."""

from __future__ import annotations

from tests.trust import readers


def test_every_reader_refuses_mutated_files_in_one_line() -> None:
    tallies = readers.fuzz(inputs=1200, seed=3)
    assert len({tally.reader for tally in tallies}) == 7
    assert [tally for tally in tallies if tally.tracebacks or tally.hangs or tally.several_lines] == []


def test_nonsense_by_rule_is_refused() -> None:
    tallies = readers.judge_nonsense(wanted=180, seed=3)
    assert sum(tally.inputs for tally in tallies) >= 180
    assert [tally.first_fault for tally in tallies if tally.accepted or tally.tracebacks] == []
