"""The files of a results page: NAME.md, NAME.csv, NAME.json and the pictures, from runs or from committed cells."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from dore.errors import InputError
from dore.files import atomic_write, read_record, write_record
from dore.report import page, plots
from dore.report.cells import read_cells, write_cells
from dore.report.facts import facts_of
from dore.report.frame import Source, Spec
from dore.report.sources import RUN_SOURCES, source_of, sources_of
from dore.report.study import cells_of


def write_page(spec: Spec, name: str, root: Path | None, results: Path) -> Path:
    """Write a study's page; the Markdown file's path.

    Where there are runs, cells and facts are made from them and written; else the committed ones are shown.

    Args:
        root: the folder of the runs; None: the study's own, if there is one.
        results: the folder of the page.

    Raises:
        InputError: no such folder, no runs in a folder that was named, or no committed cells.
    """
    sources, cells, facts = _read(spec, name, root, results)
    results.mkdir(parents=True, exist_ok=True)
    if _has_runs(sources):
        folder = root or Path(spec.get("folder", "outputs"))
        made = {one: source for one, source in spec["sources"].items() if not sources[one].committed}
        kept = {one: source for one, source in made.items() if "kept_in" in source}
        for one, source in kept.items():
            with atomic_write(results / source["kept_in"]) as file:
                source_of(one, source, folder).rows.to_csv(file, index=False, lineterminator="\n")
        if not kept:
            write_cells(results / f"{name}.csv", cells)
        write_record(results / f"{name}.json", facts)
    text = page.render(spec, cells, facts, sources)
    for figure in spec.get("figures", []):
        plots.draw(results / figure["file"], figure, cells, sources)
    with atomic_write(results / f"{name}.md") as file:
        file.write(text)
    return results / f"{name}.md"


def _read(
    spec: Spec, name: str, root: Path | None, results: Path
) -> tuple[dict[str, Source], pd.DataFrame, dict[str, Any]]:
    """The sources, cells and facts of a study; raises what `write_page` raises."""
    if root is not None and not root.is_dir():
        raise InputError(f"folder: {root} is no folder, want that of the study's runs")
    sources = sources_of(spec, root or Path(spec.get("folder", "outputs")), results)
    known = read_record(results / f"{name}.json")
    if _has_runs(sources):
        return sources, cells_of(spec, sources), facts_of(spec, sources)
    if root is not None:
        wanted = ", ".join(
            source[kind] for source in spec.get("sources", {}).values() for kind in source if kind in RUN_SOURCES
        )
        raise InputError(f"folder: no run in {root}, want some like {wanted}")
    if _has_committed(sources):
        return sources, cells_of(spec, sources), facts_of(_without(spec, known), sources) | known
    return sources, read_cells(results / f"{name}.csv"), known


def _without(spec: Spec, known: Mapping[str, Any]) -> Spec:
    """The study, but for the facts that are known."""
    return {**spec, "facts": {name: fact for name, fact in spec.get("facts", {}).items() if name not in known}}


def _has_runs(sources: Mapping[str, Source]) -> bool:
    return any(not source.runs.empty and not source.committed for source in sources.values())


def _has_committed(sources: Mapping[str, Source]) -> bool:
    return any(not source.runs.empty and source.committed for source in sources.values())
