"""What documents and docstrings name exists: code by its dotted name, files by their path."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = sorted((ROOT / "dore").rglob("*.py"))
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), ROOT / "docs" / "results" / "README.md"]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_name_of_the_code_exists(page):
    for name in sorted(set(re.findall(r"`(dore(?:\.\w+)+)`", page.read_text(encoding="utf-8")))):
        assert resolved(name), f"{page.name} names {name}"


def test_every_name_in_a_docstring_exists():
    for source in SOURCES:
        for name in sorted(set(re.findall(r"`(dore(?:\.\w+)+)`", source.read_text(encoding="utf-8")))):
            assert resolved(name), f"{source.relative_to(ROOT)} names {name}"


@pytest.mark.parametrize("page", [*PAGES, ROOT / "CONTRIBUTING.md"], ids=lambda page: page.name)
def test_every_path_of_the_repository_exists(page):
    rooted = r"`((?:dore|conf|tests|scripts|docs)/[\w./-]+)`"
    for path in sorted(set(re.findall(rooted, page.read_text(encoding="utf-8")))):
        yours = "NAME" in path or "/mine" in path
        assert yours or (ROOT / path).exists(), f"{page.name} names {path}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_leads_somewhere(page):
    for target in re.findall(r"\]\((?!http)([^)#]+)\)", page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), f"{page.name} links to {target}"


def resolved(name: str) -> bool:
    """Whether a dotted name is a module, or something in one."""
    parts = name.split(".")
    for n in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:n]))
        except ModuleNotFoundError:
            continue
        for part in parts[n:]:
            found = getattr(found, part, None)
        return found is not None
    return False
