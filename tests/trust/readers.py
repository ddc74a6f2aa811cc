"""Every reader of a file with mutated inputs, and nonsense that is made by rule.

    python -m tests.trust.readers out=outputs/trust inputs=100000 nonsense=2000

readers/rows.csv: a row a reader and kind of mutation. A traceback is any error that is not the program's own line.
nonsense/rows.csv: a row a rule; everything that is accepted there is a fault.
"""

from __future__ import annotations

import json
import random
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from types import FrameType
from typing import Any

import torch
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf
from tqdm import tqdm

from dore.app import run_folder
from dore.app.learning_keys import LEARNING
from dore.errors import InputError
from dore.files import conf_dir, read_done
from dore.learn.checkpoint import SHIPPED, load_checkpoint, load_model, save_checkpoint, save_model
from dore.report.measurements import write_measurements
from dore.report.rows import Row, read_rows, write_rows
from dore.world.files import read_plan, read_scene
from scripts.program import run
from tests.trust import nonsense

HANG_S = 2.0
VALUES: tuple[Any, ...] = (
    *(None, True, False, -1, 0, 10**6, 10**400, 0.5, -1e308, 1e-320, "", "abc", "1", [], {}, [1], {"a": 1}, "\ud800"),
    *(float("nan"), float("inf"), [[[]]], "x" * 10_000),
)
Read = Callable[[Path], object]


@dataclass
class Tally:
    """What a reader made of one kind of mutation."""

    reader: str
    kind: str
    inputs: int = 0
    refused: int = 0
    accepted: int = 0
    tracebacks: int = 0
    hangs: int = 0
    several_lines: int = 0
    first_fault: str = ""


class TooLong(BaseException):
    """A reader took longer than `HANG_S`."""


def good_files(folder: Path) -> dict[str, tuple[Path, Read]]:
    """A good file of each kind, and what reads it."""
    shared = conf_dir()
    model, checkpoint = folder / "model.safetensors", folder / "checkpoint.pt"
    weights, config = load_model(SHIPPED)
    save_model(model, {"w": next(iter(weights.values()))[:4].clone()}, config)
    save_checkpoint(checkpoint, {"progress": {"episodes": 3}, "weights": {"w": torch.arange(6.0)}})
    run = folder / "run"
    run.mkdir()
    with initialize_config_dir(str(shared), version_base="1.3"):
        cfg = compose("train", ["layout=3x6", "run_dir=run", "name=run", "sweep=x", "logger=none"])
    (run / "config.yaml").write_text(OmegaConf.to_yaml(cfg, resolve=True))
    (run / "done.json").write_text(
        json.dumps({"stop_reason": "budget", "episodes": 5, "seconds": 1.5, "best_success": 0.5})
    )
    rows = folder / "rows.csv"
    write_rows(rows, [_row(number) for number in range(1, 6)])
    return {
        "scene": (_copy(shared / "scenes" / "fig7.json", folder), read_scene),
        "plan": (_copy(shared / "plans" / "fig7.json", folder), read_plan),
        "model": (model, load_model),
        "checkpoint": (checkpoint, load_checkpoint),
        "config": (run / "config.yaml", lambda path: run_folder.read_config(path.parent, LEARNING)),
        "done": (run / "done.json", lambda path: read_done(path.parent)),
        "rows": (rows, read_rows),
    }


def _copy(path: Path, folder: Path) -> Path:
    copy = folder / f"{path.parent.name}.json"
    copy.write_bytes(path.read_bytes())
    return copy


def _row(number: int) -> Row:
    given: dict[str, Any] = {"planner": "exact", "instance": number, "n_cells": 18, "n_obstacles": 4}
    given |= {"status": "solved", "reason": "", "moves": 2, "planning_s": 0.01, "expansions": 7, "timing": "single"}
    return Row(**given)


def mutated(data: bytes, kind: str, random_: random.Random) -> bytes:
    """A mutation of a good file."""
    place = random_.randrange(len(data) + 1)
    if kind == "cut":
        return data[:place]
    if kind == "flip":
        changed = bytearray(data)
        for _ in range(random_.choice((1, 1, 2, 8))):
            changed[random_.randrange(len(data))] ^= 1 << random_.randrange(8)
        return bytes(changed)
    if kind == "insert":
        return data[:place] + random_.randbytes(random_.choice((1, 3, 40))) + data[place:]
    if kind == "splice":
        other, length = random_.randrange(len(data)), random_.randrange(1, 60)
        return data[:place] + data[other : other + length] + data[place + random_.randrange(60) :]
    return _with_other_value(data, random_)


def _with_other_value(data: bytes, random_: random.Random) -> bytes:
    """JSON with another value somewhere, or another word of a text file."""
    try:
        content = json.loads(data)
    except ValueError:
        words = data.split(b" ")
        words[random_.randrange(len(words))] = random_.choice((b"-1", b"nan", b"1e999", b"'", b"[", b"{", b"\xff", b""))
        return b" ".join(words)
    holder, key = random_.choice(list(_places(content)))
    holder[key] = random_.choice(VALUES)
    try:
        return json.dumps(content).encode()
    except ValueError:  # An int of more digits than Python prints.
        holder[key] = 10**20
        return json.dumps(content).encode()


def _places(node: Any) -> Iterator[tuple[Any, Any]]:
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in items:
        yield node, key
        yield from _places(value)


def fuzz(inputs: int, seed: int) -> list[Tally]:
    """`inputs` mutated files in all, shared alike between readers and kinds."""
    random_ = random.Random(seed)
    kinds = ("cut", "flip", "insert", "splice", "value")
    signal.signal(signal.SIGALRM, _too_long)
    tallies = []
    with tempfile.TemporaryDirectory() as made:
        files = good_files(Path(made))
        each = -(-inputs // (len(files) * len(kinds)))
        with tqdm(total=each * len(files) * len(kinds), unit="input", mininterval=5.0) as bar:
            for name, (path, read) in files.items():
                good = path.read_bytes()
                read(path)
                for kind in kinds:
                    tally = Tally(name, kind)
                    tallies.append(tally)
                    for _ in range(each):
                        path.write_bytes(mutated(good, kind, random_))
                        judge(tally, lambda read=read, path=path: read(path))  # type: ignore[misc]
                        bar.update()
                path.write_bytes(good)
    return tallies


def judge(tally: Tally, read: Callable[[], object]) -> None:
    """Read one input."""
    tally.inputs += 1
    signal.setitimer(signal.ITIMER_REAL, HANG_S)
    try:
        read()
        tally.accepted += 1
    except InputError as error:
        tally.refused += 1
        tally.several_lines += "\n" in str(error)
    except TooLong:
        tally.hangs += 1
    except Exception:
        tally.tracebacks += 1
        tally.first_fault = tally.first_fault or "; ".join(traceback.format_exc().splitlines()[-3:])
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def _too_long(signum: int, frame: FrameType | None) -> None:
    raise TooLong


def judge_nonsense(wanted: int, seed: int) -> list[Tally]:
    """Nonsense by each rule, `wanted` inputs in all."""
    signal.signal(signal.SIGALRM, _too_long)
    random_ = random.Random(seed)
    rules = nonsense.RULES
    tallies = []
    with tempfile.TemporaryDirectory() as made:
        path = Path(made) / "file.json"
        for name, (base, spoil) in rules.items():
            tally = Tally("scene" if base == "scenes" else "plan", name)
            tallies.append(tally)
            good = (conf_dir() / base / "fig7.json").read_text()
            for _ in range(-(-wanted // len(rules))):
                text = spoil(good, random_)
                path.write_text(text)
                before = tally.accepted
                judge(tally, lambda: (read_scene if base == "scenes" else read_plan)(path))  # noqa: B023
                if tally.accepted > before:
                    tally.first_fault = tally.first_fault or " ".join(text.split())[:300]
    return tallies


@dataclass(frozen=True)
class Options:
    """out: the folder of the rows; inputs, nonsense: how many in all."""

    out: Path
    inputs: int = 100_000
    nonsense: int = 2_000
    seed: int = 0


def main(options: Options) -> None:
    """Read nonsense and mutated files, and write the rows."""
    for name, tallies in (
        ("nonsense", judge_nonsense(options.nonsense, options.seed)),
        ("readers", fuzz(options.inputs, options.seed)),
    ):
        write_measurements(options.out / name, [asdict(tally) for tally in tallies], seed=options.seed)
        total = {key: sum(getattr(tally, key) for tally in tallies) for key in list(asdict(tallies[0]))[2:-1]}
        print(f"{name}: {total}")
        for tally in tallies:
            if tally.first_fault:
                print(f"  {tally.reader}, {tally.kind}: {tally.first_fault}")


if __name__ == "__main__":
    sys.exit(run(main, Options))
