"""The closing table of the demo: what was trained, evaluated, planned and executed, and where the files are.

python scripts/demo_summary.py outputs/demo SECONDS
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from dore.report import measures
from dore.report.rows import read_rows


def main(out: Path, seconds: str) -> None:
    """Print the table and the paths."""
    trained = json.loads((out / "train" / "done.json").read_text())
    plan = json.loads((out / "plan.json").read_text())
    executed = json.loads((out / "execute" / "execution.json").read_text())
    lines = []
    ipt = f"IPT {100 * trained['success']:.1f} % after {trained['episodes']} episodes, {trained['seconds']:.0f} s"
    lines.append(["train", ipt])
    for planner, rows in read_rows(out / "evaluate" / "rows.csv").groupby("planner", sort=False):
        success = measures.percent(rows, "status == 'solved'")
        moves = measures.average(rows[rows.status == "solved"], "moves")
        lines.append(
            [
                str(planner),
                f"{success.mean:.1f} % of {success.n} solved [{success.low:.1f}, {success.high:.1f}], "
                f"{moves.mean:.2f} rearrangements, p50 {measures.median(rows, '1000 * planning_s').mean:.1f} ms",
            ]
        )
    lines.append(["plan", f"{plan['status']}, {len(plan['moves'])} moves in {1000 * plan['planning_s']:.1f} ms"])
    lines.append(["execute", executed["message"]])
    lines.append(["total", f"{seconds} s"])
    for name, result in lines:
        print(f"{name:<15}{result}")
    print()
    for name in ("train/learning_curve.png", "evaluate/rows.csv", "plan.json", "plan.png"):
        print(out / name)
    for name in ("execution.json", "execution.mp4"):
        if (out / "execute" / name).exists():
            print(out / "execute" / name)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
