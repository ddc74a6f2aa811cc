"""Markdown and picture of a trained and tested run, made from its files alone.

python scripts/report_run.py OUT REPORT COMMAND: OUT holds train/ and test/; REPORT.md and REPORT.png are written.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from dore.errors import atomic_write
from dore.evaluation import read_rows
from dore.run_folder import read_config
from dore.session import CURVE
from dore.tables import as_markdown, compare, paired_table, summarise, summary_table


def main(out: Path, report: Path, command: str) -> None:
    """Write the report."""
    train = out / "train"
    done, about = json.loads((train / "done.json").read_text()), json.loads((train / "about.json").read_text())
    cfg, rows = read_config(train), read_rows(out / "test" / "rows.csv")
    world = f"{cfg.layout.rows} x {cfg.layout.cols}, {cfg.instances.min_obstacles}-{cfg.instances.max_obstacles}"
    lines = [
        f"# {world} obstacles",
        "",
        f"`{command}`, commit {about['commit']}, seed {cfg.seed}, torch {about['versions']['torch']}, "
        f"{cfg.threads} thread(s).",
        "",
        f"Trained for {done['seconds']:.0f} s: {done['episodes']:,} episodes, {done['env_steps']:,} env steps, "
        f"{done['updates']:,} updates. The test split is seen once, here; which of its instances can be solved "
        "is known where a planner has solved each of them, or proved that it has no solution.",
        "",
        as_markdown(summary_table(summarise(rows))),
        "",
        as_markdown(paired_table(compare(rows))),
        "",
        f"![Learning curve]({report.name}.png)",
    ]
    report.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(report.with_suffix(".md")) as file:
        file.write("\n".join(lines) + "\n")
    with atomic_write(report.with_suffix(".png"), "wb") as file:
        file.write((train / CURVE).read_bytes())
    print(f"{report}.md")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3])
