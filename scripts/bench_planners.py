"""Times the planners on the same instances, in one process, taking turns.

python -m scripts.bench_planners OUT [--parts a,b,c,d,e] [--learned-model FILE] [--guided-model FILE] [--limit N]
OUT/PART/rows.csv has a row a plan, or in part c a planner; `dore-report study=planners` makes the page. A time is the
wall time of `plan`, the replay of the plan included. Planners that are compared one instance at a time take turns, so
that a machine's drift hits all alike. Parts b and d take long.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import torch
from tqdm import tqdm

from dore.app import build
from dore.errors import InputError, seed_of, whole
from dore.files import conf_dir
from dore.report.measurements import write_measurements
from dore.world.files import read_scene
from dore.world.generator import Difficulty
from dore.world.plan import Status
from dore.world.problem import Batch, Problem
from scripts.planner_timing import Size, composed, one_at_a_time, process_seconds, timed, world

SCENE = conf_dir() / "scenes" / "fig7.json"
Rows = list[dict[str, Any]]


def main(arguments: list[str] | None = None) -> None:
    """Run the parts that are asked for; write their rows."""
    chosen = _arguments(arguments)
    torch.set_num_threads(1)
    load = f"{os.getloadavg()[0]:.2f}"
    models = {"6 x 6": chosen.learned_model, "8 x 8": chosen.guided_model}
    named = "; ".join(f"{name}: {model or 'the one in the package'}" for name, model in models.items())
    for part in chosen.parts:
        rows = PARTS[part](chosen)
        write_measurements(chosen.out / part, rows, seed=chosen.seed, load_before=load, models=named, threads=1)


def _arguments(given: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of the rows")
    parser.add_argument("--parts", default=",".join(PARTS), help="which of a to e, separated by commas")
    parser.add_argument("--learned-model", help="of b and c, for 6 x 6; the one in the package unless given")
    parser.add_argument("--guided-model", help="of d, for 8 x 8; the one in the package unless given")
    parser.add_argument("--limit", type=int, default=10_000, help="instances of a part at most")
    parser.add_argument("--seed", type=int, default=0, help="of the instances")
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


def exact_alone(chosen: argparse.Namespace) -> Rows:
    """Part a."""
    return _alone(Size("8x8", Difficulty(13, 13), min(1000, chosen.limit), chosen.seed), ["exact"], None)


def learned_against_search(chosen: argparse.Namespace) -> Rows:
    """Part b."""
    size = Size("6x6", Difficulty(9, 9), min(500, chosen.limit), chosen.seed)
    return _alone(size, ["graph_search", "learned"], chosen.learned_model)


def batched(chosen: argparse.Namespace) -> Rows:
    """Part c: all instances at once."""
    size = Size("6x6", Difficulty(3, 9), min(10_000, chosen.limit), chosen.seed)
    names = ["learned", "guided", "exact", "straight_line"]
    planners, instances = world(size, names, chosen.learned_model)
    rows = []
    for planner in tqdm(planners, desc="batched", unit="planner"):
        planner.plan(instances.batch(slice(64)))
        began = time.perf_counter()
        plans = planner.plan(instances.batch())
        seconds = time.perf_counter() - began
        solved = sum(plan.status is Status.SOLVED for plan in plans)
        rows.append({"planner": planner.name, "plans": len(plans), "solved": solved, "seconds": seconds})
    return rows


def guided_alone(chosen: argparse.Namespace) -> Rows:
    """Part d: with the proof of each instance."""
    size = Size("8x8", Difficulty(3, 13), min(5000, chosen.limit), chosen.seed)
    (exact,), instances = world(size, ["exact"], None)
    proofs = exact.plan(instances.batch())
    rows = _alone(size, ["guided"], chosen.guided_model)
    return [
        row | {"proof": str(proof.status), "optimum": proof.optimal_moves}
        for row, proof in zip(rows, proofs, strict=True)
    ]


def _alone(size: Size, names: list[str], model: str | None) -> Rows:
    """A row a planner and instance, planned one at a time."""
    planners, instances = world(size, names, model)
    return [
        {
            "planner": planner.name,
            "instance": number,
            "status": str(one.plan.status),
            "moves": len(one.plan.moves),
            "seconds": one.seconds,
            "cpu_seconds": one.cpu_seconds,
        }
        for planner, made in zip(planners, one_at_a_time(planners, instances), strict=True)
        for number, one in enumerate(made, 1)
    ]


def cold_start(chosen: argparse.Namespace) -> Rows:
    """Part e: processes, and the same scene again and again in this one."""
    rows: Rows = []
    for name in ("learned", "guided"):
        imports = process_seconds(sys.executable, "-c", f"import dore.app.cli, dore.app.commands, dore.planners.{name}")
        command = Path(sys.executable).with_name("dore-plan")
        with TemporaryDirectory() as folder:
            words = (f"scene={SCENE}", f"planner={name}", "reach=wide_hand", f"out={folder}/plan.json")
            whole_s = process_seconds(str(command), *words)
        rows += [{"planner": name, "what": "process", "seconds": whole_s}]
        rows += [{"planner": name, "what": "imports", "seconds": imports}]
        rows += [{"planner": name, "what": "plan", "seconds": s} for s in _resident(name, min(100, chosen.limit))]
    return rows


def _resident(name: str, times: int) -> list[float]:
    """Seconds that the scene takes again and again in this process."""
    scene = read_scene(SCENE)
    cfg = composed(["reach=wide_hand", f"planner=[{name}]"])
    reach = build.reach_of(cfg, "cpu", scene.layout)
    (planner,) = build.planners_of(cfg, reach)
    alone = Batch.of(Problem(scene, reach))
    return [timed(planner, alone).seconds for _ in range(times)]


PARTS = {"a": exact_alone, "b": learned_against_search, "c": batched, "d": guided_alone, "e": cold_start}


if __name__ == "__main__":
    main()
