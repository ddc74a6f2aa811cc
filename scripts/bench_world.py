"""Times the accessibility check and the environment, each against what it must beat, in turn in one process.

python scripts/bench_world.py [--threads N] [--out docs/results/world.md]
Prints Markdown. Every ratio is of medians over rounds in which the variants take turns, so that a machine's
drift hits all alike.
"""

from __future__ import annotations

import argparse
import json
import platform
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import torch
from torch import Tensor

from dore.files import atomic_write, commit
from dore.learn import keys
from dore.learn.env import RearrangeEnv, Rewards
from dore.world import board as boards
from dore.world.generator import Difficulty, FreshInstances
from dore.world.layout import Layout
from dore.world.reach import Reach
from dore.world.rules import legal_moves, legal_places, transition

ROUNDS = 15
REFERENCE = Path(__file__).parents[1] / "tests" / "data" / "vfh_reference.json"
PRESETS = {"published": (0.106, 30.0, 60), "wide_hand": (0.142, 15.0, 30)}


def main() -> None:
    """Run the benchmarks and print, or write, the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    parser.add_argument("--out", type=Path)
    chosen = parser.parse_args()
    torch.set_num_threads(chosen.threads)
    report = "\n".join([*_header(chosen.threads), *_reach_table(), "", *_env_table()]) + "\n"
    print(report)
    if chosen.out:
        with atomic_write(chosen.out) as file:
            file.write(report)


def medians(variants: dict[str, Callable[[], object]]) -> dict[str, float]:
    """Median seconds of each variant; they take turns, after two rounds that do not count."""
    taken: dict[str, list[float]] = {name: [] for name in variants}
    for round_ in range(ROUNDS + 2):
        for name, run in variants.items():
            began = time.perf_counter()
            run()
            if round_ >= 2:
                taken[name].append(time.perf_counter() - began)
    return {name: statistics.median(seconds) for name, seconds in taken.items()}


def _header(threads: int) -> list[str]:
    return [
        "# The accessibility check and the environment",
        "",
        f"`python scripts/bench_world.py --threads {threads}`, commit {commit()}, seed 0, torch {torch.__version__}, "
        f"{platform.machine()}, {threads} thread(s), load {Path('/proc/loadavg').read_text().split()[0]} at the start. "
        f"Medians of {ROUNDS} rounds in turn.",
        "",
    ]


def _reach_table() -> list[str]:
    agreed = _agreement()
    lines = [
        "## `Reach.accessible`, 8 x 8, B = 8192",
        "",
        f"Agrees with {agreed[0]} of {agreed[1]} decisions of the reference.",
        "",
        "| preset | plain float matmul, ms | eager, ms | compiled, ms | matmul / eager | matmul / compiled |",
        "| --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    occupied = torch.rand(8192, 64, generator=torch.Generator().manual_seed(0)) < 0.2
    for preset, numbers in PRESETS.items():
        reach = Reach(Layout.grid(8, 8, 0.12), *numbers)
        fast = reach.compiled()
        plain = _plain_matmul(reach)
        if not torch.equal(plain(occupied), fast.accessible(occupied)):
            raise SystemExit(f"{preset}: the kernels disagree")
        taken = medians(
            {
                "plain": lambda plain=plain: plain(occupied),
                "eager": lambda reach=reach: reach.accessible(occupied),
                "compiled": lambda fast=fast: fast.accessible(occupied),
            }
        )
        ms = {name: 1000 * seconds for name, seconds in taken.items()}
        lines.append(
            f"| {preset} | {ms['plain']:.1f} | {ms['eager']:.2f} | {ms['compiled']:.2f} | "
            f"{ms['plain'] / ms['eager']:.1f} | {ms['plain'] / ms['compiled']:.1f} |"
        )
    return lines


def _plain_matmul(reach: Reach) -> Callable[[Tensor], Tensor]:
    """The obvious way: count the obstacles in every sector of every cell by one float matrix product."""
    cells, sectors = reach.n_cells, reach.n_sectors
    covers = boards.unpack(reach.blockers, cells).reshape(cells * sectors, cells).T.float().contiguous()
    return lambda occupied: ((occupied.float() @ covers).view(-1, cells, sectors) < 0.5).any(-1)


def _agreement() -> tuple[int, int]:
    cases = json.loads(REFERENCE.read_text())["cases"]
    agreed = 0
    for case in cases:
        layout = Layout.grid(case["rows"], case["cols"], case["cell_m"], case["front_m"])
        reach = Reach(layout, case["r_m"], case["eta_deg"], 2 * case["eta_deg"])
        occupied = torch.zeros(1, layout.n_cells, dtype=torch.bool)
        occupied[0, case["occupied"]] = True
        agreed += bool(reach.accessible(occupied)[0, case["cell"]]) == case["accessible"]
    return agreed, len(cases)


def _env_table() -> list[str]:
    reach = Reach(Layout.grid(8, 8, 0.12), *PRESETS["wide_hand"])
    source = FreshInstances(reach, Difficulty(3, 13), "train", seed=0)
    env = RearrangeEnv(reach, source, num_envs=4096, max_moves=16, rewards=Rewards(10.0, 0.0, -1.0))
    generator = torch.Generator().manual_seed(0)
    bare, stepped, whole = [], [], []
    shown = env.reset()
    for round_ in range(2 * ROUNDS):
        acted = _random_legal(reach, shown, generator)
        state = (reach, acted[keys.BOARD], acted[keys.TARGET], acted[keys.VISITED])
        began = time.perf_counter()
        moved = transition(*state, acted[keys.PICK], acted[keys.PLACE])
        legal_moves(reach, moved.board, acted[keys.TARGET], acted[keys.VISITED])
        between = time.perf_counter()
        step = env.step(acted)
        after = time.perf_counter()
        shown = env.maybe_reset(env.step_mdp(step))
        if round_ >= ROUNDS:
            bare.append(between - began)
            stepped.append(after - between)
            whole.append(time.perf_counter() - between)
    rates = [4096 / statistics.median(seconds) for seconds in (bare, stepped, whole)]
    return [
        "## Environment steps per second, 8 x 8, 3-13 obstacles, B = 4096, random legal actions",
        "",
        "Bare: `rules.transition` and the next `rules.legal_moves`, no TorchRL. Choosing the actions is not counted.",
        "",
        "| | steps/s | of bare |",
        "| --- | ---: | ---: |",
        f"| bare functions | {rates[0]:,.0f} | 1.00 |",
        f"| `EnvBase.step` | {rates[1]:,.0f} | {rates[1] / rates[0]:.2f} |",
        f"| step and reset of finished rows | {rates[2]:,.0f} | {rates[2] / rates[0]:.2f} |",
    ]


def _random_legal(reach: Reach, shown, generator: torch.Generator):  # type: ignore[no-untyped-def]
    pick = shown[keys.PICK_MASK].float().multinomial(1, generator=generator).squeeze(-1)
    places = legal_places(reach, shown[keys.BOARD], shown[keys.TARGET], shown[keys.VISITED], pick)
    place = places.float().multinomial(1, generator=generator).squeeze(-1)
    return shown.set(keys.PICK, pick).set(keys.PLACE, place)


if __name__ == "__main__":
    main()
