"""The report library on small frames: filters, pairs, formats, the CSV round trip, and what bad input gets."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pandas as pd
import pytest
import yaml

from dore.errors import InputError
from dore.report import cells as cell_files
from dore.report import measures, page, results, runs
from dore.report.facts import facts_of
from dore.report.sources import sources_of
from dore.report.study import cells_of
from tests.commands import TINY
from tests.report.fakes import evaluation, rows_of

ROOT = Path(__file__).parents[2]


def example() -> dict:
    """The study of docs/studies.md."""
    (text,) = re.findall(r"```yaml\n(.*?)```", (ROOT / "docs" / "studies.md").read_text(encoding="utf-8"), re.S)
    return yaml.safe_load(text)


def test_the_study_in_the_docs_is_a_study(tmp_path):
    spec = example()
    jobs = [job for some in runs.jobs_of(spec, tmp_path) for job in some]
    assert [job.folder.relative_to(tmp_path).as_posix() for job in jobs[:2]] == [
        "train/independent_0",
        "train/independent_1",
    ]
    assert f"model={tmp_path}/train/mean_1" in jobs[-1].words
    for heads, moves in (("independent", (1, 2, None)), ("mean", (1, None, None))):
        for seed in (0, 1):
            evaluation(tmp_path / f"test/{heads}_{seed}", [*rows_of("learned", *moves), *rows_of("exact", 1, 2, 2)])
    text = results.write_page(spec, "mine", tmp_path, tmp_path / "docs").read_text(encoding="utf-8")
    assert "| independent | 66.7 (0) [66.7, 66.7] | 1 (0) [1, 1] |" in text
    assert "commit abc1234, seed 0 of the instances" in text


def cells_from(tmp_path: Path, **entry: object) -> pd.DataFrame:
    spec = {
        "title": "t",
        "sources": {"tested": {"evaluations": "{column}", "same": ["column"]}},
        "tables": [{"name": "t", "cells": [{"row": "{planner}", "from": "tested", **entry}]}],
    }
    return cells_of(spec, sources_of(spec, tmp_path, tmp_path))


@pytest.fixture
def two(tmp_path):
    """`a` and `b` on four instances, of which both solve the first two."""
    evaluation(
        tmp_path / "z3", [*rows_of("a", 2, 4, 6, None), *rows_of("b", 1, 2, None, 3), *rows_of("exact", 1, 2, 2, 3)]
    )
    return tmp_path


def test_pairs_are_of_the_same_instances(two):
    found = cells_from(
        two,
        where="planner == 'a' and solved",
        base="planner == 'b' and solved",
        measure="ratio",
        of="moves",
        to="moves_base",
    )
    assert found[["row", "column", "n", "mean"]].to_numpy().tolist() == [["a", "z3", 2, 2.0]]
    found = cells_from(
        two, where="planner == 'a'", only_with="planner == 'b' and not solved", measure="average", of="moves"
    )
    assert found["mean"].tolist() == [6]


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        ({"measure": "luck"}, "measure: got 'luck', want a function of dore.report.measures"),
        ({"measure": "mean", "of": "lengths"}, "of: 'lengths'"),
        ({"measure": "row_count", "where": "planer == 'a'"}, r"tables.t.cells.0.where: .*planer"),
        ({"measure": "row_count", "row": "{planer}"}, r"tables.t.cells.0: no 'planer'"),
        ({"paper": "table 9", "rows": {}}, "paper: got 'table 9', want one of"),
    ],
)
def test_what_does_not_fit_is_one_line(two, entry, says):
    with pytest.raises(InputError, match=says) as error:
        cells_from(two, **entry)
    assert "\n" not in str(error.value)


def test_damaged_files_are_one_line(two):
    path = two / "z3" / "rows.csv"
    whole = path.read_text(encoding="utf-8")
    path.write_text(whole.replace(",36,", ",many,", 1), encoding="utf-8")
    with pytest.raises(InputError, match=r"rows.csv, line 2: n_cells 'many', want a number"):
        cells_from(two, measure="row_count")
    path.write_text(whole.replace("moves", "steps", 1), encoding="utf-8")
    with pytest.raises(InputError, match=r"rows.csv: no column moves"):
        cells_from(two, measure="row_count")
    with pytest.raises(InputError, match=r"none.csv: no such file"):
        cell_files.read_cells(two / "none.csv")


def test_a_source_of_no_kind_and_a_run_of_no_kind_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"sources.a: got folders, want one of evaluations"):
        sources_of({"sources": {"a": {"folders": "x"}}}, tmp_path, tmp_path)
    with pytest.raises(InputError, match=r"runs.0: got trains, want one of train, evaluate"):
        list(runs.jobs_of({"runs": [{"trains": "x"}]}, tmp_path))
    with pytest.raises(InputError, match=r"runs.0: no 'seed' in `given`"):
        list(runs.jobs_of({"runs": [{"train": "x{seed}"}]}, tmp_path))


CELLS = pd.DataFrame(
    [
        ("m", "paper", "3", 10, 1.5, 0.25, math.nan, math.nan, ""),
        ("m", "ours", "3", 500, 0.123456, 0.02, 0.12, 0.127, ""),
        ("m", "ours", "all", 900, 1234.5, math.nan, 1000, 1500, ""),
        ("m", "words", "3", math.nan, math.nan, math.nan, math.nan, math.nan, "as wide"),
    ],
    columns=[*cell_files.CELL, cell_files.TEXT],
)


def test_cells_read_as_they_were_written(tmp_path):
    cell_files.write_cells(tmp_path / "c.csv", CELLS)
    again = cell_files.read_cells(tmp_path / "c.csv")
    pd.testing.assert_frame_equal(again, CELLS.astype({"n": float}), check_dtype=False)


def test_how_cells_are_shown():
    table = {"name": "m", "head": "z", "digits": 3, "n": "each", "missing": "none"}
    assert page.table_of(CELLS, table).splitlines() == [
        "| z | 3 | all |",
        "| --- | ---: | ---: |",
        "| paper | 1.50 (0.25), n 10 | none |",
        "| ours | 0.123 (0.020) [0.120, 0.127], n 500 | 1,234 [1,000, 1,500], n 900 |",
        "| words | as wide | none |",
    ]
    shown = page.table_of(CELLS, {"name": "m", "format": "{mean:.1f}", "columns": {"all": "all of them"}})
    assert shown.splitlines()[0] == "|  | all of them | 3 |"
    assert "| ours | 1234.5 | 0.1 |" in shown


def test_a_run_that_is_done_is_skipped_and_old_evaluations_are_not(tmp_path):
    spec = {"runs": [{"evaluate": "test", "model": "{root}/model.safetensors"}]}
    ((job,),) = runs.jobs_of(spec, tmp_path)
    assert not job.done
    evaluation(tmp_path / "test", rows_of("a", 1))
    assert job.done
    model = tmp_path / "model.safetensors"
    model.touch()
    assert not job.done
    assert any(word.startswith("resume=") for word in job.command())
    assert runs.make_missing({"runs": [{"evaluate": "new", "model": "{root}/no_model"}]}, tmp_path, 1) == 0


@pytest.mark.slow
def test_missing_runs_are_made_once(tmp_path, capfd):
    """The study of the docs with models of seconds: trained, evaluated, shown; then nothing is left to do."""
    spec = example()
    spec["given"] |= {"heads": ["mean"], "minutes": 0.05}
    for entry, more in zip(spec["runs"], ([*TINY, "training.max_episodes=60"], ["limit=5"]), strict=True):
        entry["overrides"] = [*entry["overrides"], *more]
    assert runs.make_missing(spec, tmp_path, 2) == 0
    assert capfd.readouterr().out.count("== ") == 4
    assert runs.make_missing(spec, tmp_path, 1) == 0
    assert capfd.readouterr().out.count("2 of 2 runs") == 2
    assert "| mean |" in results.write_page(spec, "mine", tmp_path, tmp_path / "docs").read_text(encoding="utf-8")
    (tmp_path / "test" / "mean_0" / "rows.csv").unlink()
    (tmp_path / "test" / "mean_0" / "config.yaml").write_text("nothing", encoding="utf-8")
    assert runs.make_missing(spec, tmp_path, 1) == 2
    assert "mean_0: ended with exit code 2" in capfd.readouterr().err


def test_success_is_not_said_while_an_instance_is_undecided(two):
    """Of z4 nobody solves the second instance, and nobody proves that it cannot be solved."""
    evaluation(two / "z4", [*rows_of("a", 2, None), *rows_of("exact", 1, None)])
    found = cells_from(two, where="planner == 'a'", measure="solved_of_decided").set_index("column")["mean"]
    assert found["z3"] == 75
    assert math.isnan(found["z4"])
    assert cells_from(two, where="column == 'z4'", measure="solved_of_solvable")["mean"].tolist() == [100, 100]


def test_a_fact_is_of_the_runs_that_it_names(tmp_path):
    for name, limit in (("many", 9), ("few", 4)):
        evaluation(tmp_path / name, rows_of("a", 1, 2), limit=limit)
    source = {"tested": {"evaluations": "{run}", "same": ["run"]}}
    limit = {"from": "tested", "run": "config.limit"}
    facts = {"all": limit, "few": {**limit, "where": "run == 'few'"}}
    found = facts_of({"facts": facts}, sources_of({"sources": source}, tmp_path, tmp_path))
    assert (found["all"], found["few"]) == ("4, 9", "4")


def test_a_root_mean_square_lacks_nothing_and_a_stated_interval_is_symmetric():
    rows = pd.DataFrame({"off": [3.0, -4.0], "gap": [1.0, math.nan], "high": [5.0, 9.0]})
    assert measures.rms(rows, "off").mean == pytest.approx(math.sqrt(12.5))
    assert math.isnan(measures.rms(rows, "gap").mean)
    stated = measures.stated(rows, "off", "high")
    assert (stated.mean, stated.low, stated.high) == (3, 1, 5)


def test_a_programs_rows_are_kept_beside_the_page_and_read_there_without_the_run(tmp_path):
    entry = {"row": "a", "column": "b", "from": "made", "measure": "total", "of": "double"}
    spec = {
        "title": "t",
        "sources": {"made": {"measurements": ".", "kept_in": "mine.csv", "define": {"double": "2 * a"}}},
        "facts": {"arm": {"from": "made", "run": "about.arm"}},
        "head": "{{ facts.commit }}, {{ facts.arm }}",
        "tables": [{"name": "sum", "cells": [entry]}],
    }
    run, docs = tmp_path / "run", tmp_path / "docs"
    run.mkdir()
    (run / "rows.csv").write_text("a\n1\n2.5\n", encoding="utf-8")
    (run / "about.json").write_text('{"commit": "abc1234", "arm": "slim"}', encoding="utf-8")
    page = results.write_page(spec, "mine", run, docs).read_text(encoding="utf-8")
    assert "abc1234, slim" in page
    assert "| a | 7 |" in page
    assert (docs / "mine.csv").read_text(encoding="utf-8") == "a\n1.0\n2.5\n"
    spec["folder"] = str(tmp_path / "gone")
    assert results.write_page(spec, "mine", None, docs).read_text(encoding="utf-8") == page
