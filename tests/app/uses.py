"""Makes docs/uses.md again: its commands run in an empty folder with the wheel; their output replaces the old.

python -m tests.app.uses [SECTION ...] (the first words of their titles; all of them, if none is given)
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "uses.md"
FIGURE = re.compile(r"!\[[^]]*\]\((images/\S+)\)\n<!-- (\S+) -->")
"""A figure of the page, and the file in the folder of a section that it is a copy of."""


def installed(folder: Path) -> Path:
    """The wheel of this checkout, without its dependencies, which this environment has."""
    subprocess.run([sys.executable, "-m", "build", "--wheel", "--outdir", folder, ROOT], check=True, stdout=sys.stderr)
    (wheel,) = folder.glob("*.whl")
    target = folder / "site"
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", target, wheel]
    subprocess.run(install, check=True)
    return target


def write_files(folder: Path, section: str) -> None:
    """The Python and YAML blocks of a section, each under the path that a comment in it names."""
    for block in re.findall(r"```(?:python|yaml)\n(.*?)```", section, flags=re.S):
        path = folder / re.search(r"^# ([\w./]+\.(?:py|yaml))$", block, flags=re.M)[1]
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(block, encoding="utf-8")


def transcribed(section: str, folder: Path, site: Path) -> str:
    """A section with the output that its commands have in `folder`, and its figures copied."""
    write_files(folder, section)
    environment = {**os.environ, "PYTHONPATH": str(site), "PATH": f"{site / 'bin'}:{os.environ['PATH']}"}

    def run(block: re.Match[str]) -> str:
        done = subprocess.run(
            ["bash", "-e", "-c", block[1]], cwd=folder, env=environment, stdout=subprocess.PIPE, text=True
        )
        return f"```sh\n{block[1]}```\n\n```text\n{done.stdout.rstrip()}\n```\n"

    made = re.sub(r"```sh\n(.*?)```\n\n```text\n.*?\n```\n", run, section, flags=re.S)
    for picture, source in FIGURE.findall(section):
        shutil.copy(folder / source, PAGE.parent / picture)
    return made


def main(titles: list[str]) -> None:
    """Make the sections whose titles begin with one of these words."""
    with tempfile.TemporaryDirectory() as home:
        site = installed(Path(home))
        head, *sections = re.split(r"^(?=## )", PAGE.read_text(encoding="utf-8"), flags=re.M)
        for number, section in enumerate(sections):
            if not titles or section.removeprefix("## ").startswith(tuple(titles)):
                folder = Path(home) / str(number)
                folder.mkdir()
                sections[number] = transcribed(section, folder, site)
                PAGE.write_text(head + "".join(sections), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
