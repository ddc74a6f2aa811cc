"""Times the planners on the same instances, in one process, taking turns.

python -m scripts.bench_planners [--parts a,b,c,d,e] [--out docs/results/planners.md]
Prints Markdown; scripts/bench_planners.sh has the command behind the page. A time is the wall time of `plan`, the
replay of the plan included. Planners that are compared one instance at a time take turns, so that a machine's drift
hits all alike.
"""

from __future__ import annotations

import argparse
import math
import os
import platform
import sys
import time
from pathlib import Path
from statistics import fmean, median
from tempfile import TemporaryDirectory

import torch
from tqdm import tqdm

from dore.app import build
from dore.errors import InputError, seed_of, whole
from dore.files import atomic_write, commit, conf_dir
from dore.planners.base import label
from dore.report.sources import paper_table
from dore.report.tables import Table, as_markdown
from dore.world.files import read_scene
from dore.world.generator import Difficulty
from dore.world.plan import Status
from dore.world.problem import Batch, Problem
from scripts.planner_timing import Size, about, composed, one_at_a_time, process_seconds, share, spread, timed, world

SCENE = conf_dir() / "scenes" / "fig7.json"


def main(arguments: list[str] | None = None) -> None:
    """Run the parts that are asked for; print the page, and write it."""
    chosen = _arguments(arguments)
    torch.set_num_threads(1)
    load = os.getloadavg()[0]
    sections = [part(chosen) for name, part in PARTS.items() if name in chosen.parts]
    page = "\n".join(line for lines in [_header(chosen, load), *sections] for line in [*lines, ""])
    print(page)
    if chosen.out:
        with atomic_write(chosen.out) as file:
            file.write(page.rstrip("\n") + "\n")


def _arguments(given: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--parts", default=",".join(PARTS), help="which of a to e, separated by commas")
    parser.add_argument("--learned-model", help="of b and c, for 6 x 6; the one in the package unless given")
    parser.add_argument("--guided-model", help="of d, for 8 x 8; the one in the package unless given")
    parser.add_argument("--limit", type=int, default=10_000, help="instances of a part at most")
    parser.add_argument("--seed", type=int, default=0, help="of the instances")
    parser.add_argument("--out", type=Path, help="the page")
    chosen = parser.parse_args(given)
    chosen.parts = chosen.parts.split(",")
    try:
        if unknown := [name for name in chosen.parts if name not in PARTS]:
            raise InputError(f"--parts: got {', '.join(unknown)}, want some of {', '.join(PARTS)}")
        whole("--limit", chosen.limit, 1)
        seed_of("--seed", chosen.seed)
    except InputError as error:
        parser.error(str(error))
    return chosen


def _header(chosen: argparse.Namespace, load: float) -> list[str]:
    models = {"6 x 6": chosen.learned_model, "8 x 8": chosen.guided_model}
    named = "; ".join(f"{name}: {model or 'the one in the package'}" for name, model in models.items())
    return [
        "# Planners",
        "",
        f"`scripts/bench_planners.sh`, parts {', '.join(chosen.parts)}, commit {commit()}, seed {chosen.seed}, "
        f"torch {torch.__version__}, {platform.machine()}, {torch.get_num_threads()} thread, load {load:.2f} at the "
        f"start and {os.getloadavg()[0]:.2f} at the end. Reach `wide_hand`. Models: {named}. A time is the wall time "
        "of `plan`, the replay of the plan included; CPU time leaves out what other programs took.",
    ]


def exact_alone(chosen: argparse.Namespace) -> list[str]:
    """Part a."""
    size = Size("8x8", Difficulty(13, 13), min(1000, chosen.limit), chosen.seed)
    planners, instances = world(size, ["exact"], None)
    (rows,) = one_at_a_time(planners, instances)
    wall_ms, cpu_ms = [1000 * row.seconds for row in rows], [1000 * row.cpu_seconds for row in rows]
    decided = sum(row.plan.status is not Status.GAVE_UP and row.seconds <= 5 for row in rows)
    ended = ", ".join(f"{sum(row.plan.status is one for row in rows)} {one}" for one in Status)
    return [
        f"## a. `exact`, {about(size)}, one at a time",
        "",
        as_markdown(
            [
                ["ms", "median", "p90", "p99", "max", "decided within 5 s"],
                ["wall", *spread(wall_ms, (50, 90, 99, 100)), share(decided, len(rows))],
                ["CPU", *spread(cpu_ms, (50, 90, 99, 100)), ""],
            ]
        ),
        "",
        f"How they ended: {ended}.",
    ]


def learned_against_search(chosen: argparse.Namespace) -> list[str]:
    """Part b."""
    size = Size("6x6", Difficulty(9, 9), min(500, chosen.limit), chosen.seed)
    planners, instances = world(size, ["graph_search", "learned"], chosen.learned_model)
    table: Table = [["ms", "mean", "median", "p99", "solved"]]
    means, medians = [], []
    for planner, rows in zip(planners, one_at_a_time(planners, instances), strict=True):
        ms = [1000 * row.seconds for row in rows]
        means.append(fmean(ms))
        medians.append(median(ms))
        solved = sum(row.plan.status is Status.SOLVED for row in rows)
        table.append([planner.name, f"{means[-1]:.2f}", *spread(ms, (50, 99)), share(solved, len(rows))])
    table_1 = paper_table("planning_time_6x6").pivot(index="column", columns="method", values="mean")
    paper = table_1.graph_search["9"] / table_1.dqn["9"]
    table.append(["ratio", f"{means[0] / means[1]:.0f}", f"{medians[0] / medians[1]:.2f}", "", ""])
    return [
        f"## b. `learned` against `graph_search`, {about(size)}, one at a time",
        "",
        as_markdown(table),
        "",
        f"The paper's ratio of the means is {paper:.1f} (Table 1, 9 obstacles). A search that gives up counts "
        "with the time it took, so the ratio of the means is at least this.",
    ]


def batched(chosen: argparse.Namespace) -> list[str]:
    """Part c."""
    size = Size("6x6", Difficulty(3, 9), min(10_000, chosen.limit), chosen.seed)
    names = ["learned", "guided", "exact", "straight_line"]
    planners, instances = world(size, names, chosen.learned_model)
    table: Table = [["planner", "seconds", "plans/s", "solved"]]
    for planner in tqdm(planners, desc="batched", unit="planner"):
        planner.plan(instances.batch(slice(64)))
        began = time.perf_counter()
        plans = planner.plan(instances.batch())
        seconds = time.perf_counter() - began
        solved = sum(plan.status is Status.SOLVED for plan in plans)
        table.append([planner.name, f"{seconds:.1f}", f"{len(plans) / seconds:,.0f}", share(solved, len(plans))])
    return [f"## c. All at once, {about(size)}", "", as_markdown(table)]


def guided_alone(chosen: argparse.Namespace) -> list[str]:
    """Part d."""
    size = Size("8x8", Difficulty(3, 13), min(5000, chosen.limit), chosen.seed)
    (exact, guided), instances = world(size, ["exact", "guided"], chosen.guided_model)
    labels = label(instances, exact)
    (rows,) = one_at_a_time([guided], instances)
    solvable = labels.status.count(Status.SOLVED)
    solved = [
        (len(row.plan.moves), fewest)
        for row, fewest in zip(rows, labels.optimal_moves, strict=True)
        if row.plan.status is Status.SOLVED and fewest
    ]
    ratio = fmean(moves / fewest for moves, fewest in solved) if solved else math.nan
    wall_ms, cpu_ms = [1000 * row.seconds for row in rows], [1000 * row.cpu_seconds for row in rows]
    missed = f"{solvable - len(solved)} of {solvable}"
    found = [share(len(solved), solvable), missed, f"{ratio:.4f}"]
    return [
        f"## d. `guided`, {about(size)}, one at a time",
        "",
        as_markdown(
            [
                ["", "of the solvable", "missed", "moves / optimum", "p50 ms", "p99 ms", "max ms"],
                ["wall", *found, *spread(wall_ms, (50, 99, 100))],
                ["CPU", "", "", "", *spread(cpu_ms, (50, 99, 100))],
            ]
        ),
        "",
        f"By `exact`: {solvable} can be solved, {labels.status.count(Status.UNSOLVABLE)} cannot, "
        f"{labels.status.count(Status.GAVE_UP)} are not decided and count for neither. The ratio is the mean over "
        "instances.",
    ]


def cold_start(chosen: argparse.Namespace) -> list[str]:
    """Part e."""
    table: Table = [["", "`dore-plan`, s", "of it imports, s", "resident: first, ms", "median, ms", "max, ms"]]
    for name in ("learned", "guided"):
        imports = process_seconds(sys.executable, "-c", f"import dore.app.cli, dore.app.commands, dore.planners.{name}")
        command = Path(sys.executable).with_name("dore-plan")
        with TemporaryDirectory() as folder:
            words = (f"scene={SCENE}", f"planner={name}", "reach=wide_hand", f"out={folder}/plan.json")
            whole_s = process_seconds(str(command), *words)
        ms = _resident_ms(name, min(100, chosen.limit))
        table.append(
            [name, f"{whole_s:.2f}", f"{imports:.2f}", *(f"{one:.1f}" for one in (ms[0], median(ms), max(ms)))]
        )
    return [
        f"## e. From a cold start: `dore-plan scene=conf/scenes/{SCENE.name} planner=...`",
        "",
        as_markdown(table),
        "",
        "Medians of 3 processes; they write and draw the plan too. Resident: the same scene again and again in this "
        "process.",
    ]


def _resident_ms(name: str, times: int) -> list[float]:
    """What the scene takes again and again in this process."""
    scene = read_scene(SCENE)
    cfg = composed(["reach=wide_hand", f"planner=[{name}]"])
    reach = build.reach_of(cfg, "cpu", scene.layout)
    (planner,) = build.planners_of(cfg, reach)
    alone = Batch.of(Problem(scene, reach))
    return [1000 * timed(planner, alone).seconds for _ in range(times)]


PARTS = {"a": exact_alone, "b": learned_against_search, "c": batched, "d": guided_alone, "e": cold_start}


if __name__ == "__main__":
    main()
