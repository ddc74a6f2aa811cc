"""The boards that the network fails on though a plan is proved: counted, explained by the lanes' costs, and drawn.

python -m scripts.failures [--model FILE] [--columns 8x8_z3-13 6x6_z3-8] [--boards 5000] [--report REPORT]
Boards are of the validation split, so that the test split stays unseen. REPORT.md and REPORT.png are written.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import torch
from hydra.errors import HydraException
from tqdm import tqdm

from dore.errors import InputError, whole
from dore.files import atomic_write
from dore.learn.checkpoint import SHIPPED
from scripts.failures_figure import draw, drawn_of
from scripts.failures_found import column_of
from scripts.failures_page import page

COLUMNS = ("8x8_z3-13", "6x6_z3-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the page and the picture; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", type=Path, default=SHIPPED, help="a run directory or a model file")
    parser.add_argument("--columns", nargs="+", default=COLUMNS, help="LAYOUT_INSTANCES")
    parser.add_argument("--boards", type=int, default=5000, help="of each column")
    parser.add_argument("--report", type=Path, default=Path("docs/results/failures"))
    chosen = parser.parse_args(arguments)
    torch.set_num_threads(1)
    try:
        whole("--boards", chosen.boards, 1)
        with tqdm(chosen.columns, unit="column") as names:
            columns = [column_of(name, chosen.model, chosen.boards) for name in names]
    except (InputError, HydraException) as error:
        print(f"failures: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    chosen.report.parent.mkdir(parents=True, exist_ok=True)
    drawn, picture = drawn_of(columns), chosen.report.with_suffix(".png")
    if drawn:
        draw(picture, drawn)
    else:
        picture.unlink(missing_ok=True)
    command = f"python -m scripts.failures --columns {' '.join(chosen.columns)} --boards {chosen.boards}"
    shipped = chosen.model.resolve() == SHIPPED.resolve()
    model = SHIPPED.name if shipped else str(chosen.model)
    command += "" if shipped else f" --model {model}"
    lines = page(columns, model, command, picture.name if drawn else None)
    with atomic_write(chosen.report.with_suffix(".md")) as file:
        file.write("\n".join(lines) + "\n")
    print(chosen.report.with_suffix(".md"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
