"""Times the planners on the same instances, in one process, taking turns.

python -m scripts.bench_planners out=FOLDER [parts=[a,b,c,d,e]] [learned_model=FILE] [guided_model=FILE] [limit=N]
FOLDER/PART/rows.csv has a row a plan, or in part c a planner; `dore-report study=planners` makes the page. A time is
the wall time of `plan`, the replay of the plan included. Planners that are compared one instance at a time take turns,
so that a machine's drift hits all alike. Parts b and d take long.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

from tqdm import tqdm

from dore.errors import InputError
from dore.files import conf_dir
from dore.planners.base import Planner
from dore.report.measurements import write_measurements
from dore.world.files import read_scene
from dore.world.generator import Difficulty
from dore.world.instances import InstanceSet
from dore.world.plan import Status
from dore.world.problem import Batch, Problem
from scripts.program import planners_on, run

SCENE = conf_dir() / "scenes" / "fig7.json"
Rows = list[dict[str, Any]]


@dataclass(frozen=True)
class Options:
    """out: the folder of the rows. limit: instances of a part at most. seed: of the instances.

    learned_model: of b and c, for 6 x 6; guided_model: of d, for 8 x 8; the one in the package unless given.
    """

    out: Path
    parts: list[str] = field(default_factory=lambda: list(PARTS))
    learned_model: Path | None = None
    guided_model: Path | None = None
    limit: int = 10_000
    seed: int = 0

    def __post_init__(self) -> None:
        if unknown := [name for name in self.parts if name not in PARTS]:
            raise InputError(f"parts: got {', '.join(unknown)}, want some of {', '.join(PARTS)}")


def main(options: Options) -> None:
    """Run the parts that are asked for; write their rows."""
    load = f"{os.getloadavg()[0]:.2f}"
    models = {"6 x 6": options.learned_model, "8 x 8": options.guided_model}
    named = "; ".join(f"{name}: {model or 'the one in the package'}" for name, model in models.items())
    for part in options.parts:
        rows = PARTS[part](options)
        write_measurements(options.out / part, rows, seed=options.seed, load_before=load, models=named, threads=1)


def exact_alone(options: Options) -> Rows:
    """Part a."""
    return in_turn(*world(options, 1000, "8x8", Difficulty(13, 13), ["exact"]))


def learned_against_search(options: Options) -> Rows:
    """Part b."""
    names = ["graph_search", "learned"]
    return in_turn(*world(options, 500, "6x6", Difficulty(9, 9), names, options.learned_model))


def batched(options: Options) -> Rows:
    """Part c: all instances at once."""
    names = ["learned", "guided", "exact", "straight_line"]
    planners, instances = world(options, 10_000, "6x6", Difficulty(3, 9), names, options.learned_model)
    rows = []
    for planner in tqdm(planners, desc="batched", unit="planner"):
        planner.plan(instances.batch(slice(64)))
        began = time.perf_counter()
        plans = planner.plan(instances.batch())
        seconds = time.perf_counter() - began
        solved = sum(plan.status is Status.SOLVED for plan in plans)
        rows.append({"planner": planner.name, "plans": len(plans), "solved": solved, "seconds": seconds})
    return rows


def guided_alone(options: Options) -> Rows:
    """Part d: with the proof of each instance."""
    (guided, exact), instances = world(
        options, 5000, "8x8", Difficulty(3, 13), ["guided", "exact"], options.guided_model
    )
    proofs = exact.plan(instances.batch())
    return [
        row | {"proof": str(proof.status), "optimum": proof.optimal_moves}
        for row, proof in zip(in_turn([guided], instances), proofs, strict=True)
    ]


def cold_start(options: Options) -> Rows:
    """Part e: processes, and the same scene again and again in this one."""
    scene, rows = read_scene(SCENE), []
    for name in ("learned", "guided"):
        imports = process_seconds(sys.executable, "-c", f"import dore.app.cli, dore.app.plan, dore.planners.{name}")
        command = Path(sys.executable).with_name("dore-plan")
        with TemporaryDirectory() as folder:
            words = (f"scene={SCENE}", f"planner={name}", "reach=wide_hand", f"out={folder}/plan.json")
            whole_s = process_seconds(str(command), *words)
        reach, (planner,) = planners_on("3x6", [name], None, f"layout.front_m={scene.layout.front_m}")
        alone = Batch.of(Problem(scene, reach))
        plans = [timed(planner, alone)["seconds"] for _ in range(min(100, options.limit))]
        timings = [("process", whole_s), ("imports", imports), *(("plan", seconds) for seconds in plans)]
        rows += [{"planner": name, "what": what, "seconds": seconds} for what, seconds in timings]
    return rows


PARTS: dict[str, Callable[[Options], Rows]] = {
    "a": exact_alone,
    "b": learned_against_search,
    "c": batched,
    "d": guided_alone,
    "e": cold_start,
}


def world(
    options: Options, most: int, layout: str, obstacles: Difficulty, planners: list[str], model: Path | None = None
) -> tuple[list[Planner], InstanceSet]:
    """Planners on a layout, and `most` instances of the test split, or fewer by the options' limit."""
    reach, found = planners_on(layout, planners, model)
    return found, InstanceSet.generate(reach, min(most, options.limit), obstacles, "test", options.seed)


def in_turn(planners: list[Planner], instances: InstanceSet) -> Rows:
    """A row a plan: the planners take turns, an instance at a time, after one that does not count."""
    for planner in planners:
        planner.plan(instances.batch(slice(1)))
    return [
        {"planner": planner.name, "instance": row + 1, **timed(planner, instances.batch(slice(row, row + 1)))}
        for row in tqdm(range(len(instances)), unit="instance")
        for planner in planners
    ]


def timed(planner: Planner, alone: Batch) -> dict[str, Any]:
    """One plan, and the wall and CPU seconds that it took."""
    began, cpu_began = time.perf_counter(), time.process_time()
    (plan,) = planner.plan(alone)
    seconds, cpu_seconds = time.perf_counter() - began, time.process_time() - cpu_began
    return {"status": str(plan.status), "moves": len(plan.moves), "seconds": seconds, "cpu_seconds": cpu_seconds}


def process_seconds(*command: str) -> float:
    """Median wall seconds of a program with one thread, run three times."""
    taken = []
    for _ in range(3):
        began = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True, env={**os.environ, "OMP_NUM_THREADS": "1"})
        taken.append(time.perf_counter() - began)
    return median(taken)


if __name__ == "__main__":
    sys.exit(run(main, Options))
