"""Where the package's own files are; it loads nothing."""

from __future__ import annotations

from pathlib import Path


def conf_dir() -> Path:
    """The configs: inside the installed package, or beside it in a checkout."""
    packed = Path(__file__).parent / "conf"
    return packed if packed.is_dir() else Path(__file__).parents[1] / "conf"
