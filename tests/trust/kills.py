"""Commands that are killed, started twice, or given a disk that is full or read-only: is anything lost, or wrong?

    python -m tests.trust.kills out=outputs/trust

kills/rows.csv: a row a trial; `lost`: what a resumed command could not find again; `wrong`: a result that differs from
that of a command that nothing happened to. Needs the right to mount a small disk in memory for the last of these.
"""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from tqdm import tqdm

from dore.files import conf_dir, read_record
from dore.learn.checkpoint import load_checkpoint, load_model
from dore.report.measurements import write_measurements
from dore.report.rows import read_rows
from scripts.program import run
from tests.commands import TINY
from tests.learn.runs import rows_of, same
from tests.trust.trials import Trial, checked, finish, kill, small_disk, start, time_of, wait_for

TRAIN = (*TINY, "training.max_episodes=1500", "checkpoint_minutes=0.002")
EVALUATE = ("planner=[straight_line,learned]", "layout=3x6", "instances=z3-7", "limit=300")
SWEEP = ("-m", "seed=0,1", *TINY, "training.max_episodes=600", "checkpoint_minutes=0.002", "hydra/launcher=basic")
EXECUTE = ("video=off",)


def killed_trainings(home: Path, kills: int, random_: random.Random) -> Iterator[Trial]:
    """A run that is killed again and again until it ends, against one that is left alone."""
    whole_s = time_of("train", *TRAIN, "run_dir=whole", cwd=home)

    def faults(folder: Path) -> list[str]:
        ended = "stop_reason" in read_record(folder / "done.json")
        return [
            *(["it did not end"] if not ended else []),
            *(["other rows"] if rows_of(folder / "metrics.csv") != rows_of(home / "whole" / "metrics.csv") else []),
            *(["other weights"] if not same(load_model(folder), load_model(home / "whole")) else []),
        ]

    done, number = 0, 0
    while done < kills:
        folder, here = home / f"killed{number}", 0
        number += 1
        while True:
            process = start("train", *TRAIN, f"run_dir={folder.name}", "existing=continue", cwd=home)
            enough = done + here >= kills or here >= 5
            if enough or not kill(process, random_.uniform(0.2, 0.9) * whole_s):
                code, said = finish(process) if enough else (process.returncode, "")
                break
            here += 1
            if (folder / "checkpoint.pt").exists():
                load_checkpoint(folder / "checkpoint.pt")
        trial = checked(Trial("train", "killed", here, message=said), lambda folder=folder: faults(folder))  # type: ignore[misc]
        trial.wrong += code != 0
        done += here
        whole_s *= 1.0 if here else 0.8  # The machine has become faster.
        yield trial


def killed_evaluations(home: Path, kills: int, random_: random.Random) -> Iterator[Trial]:
    """An evaluation that is killed and resumed until it ends."""
    whole_s = time_of("evaluate", *EVALUATE, "run_dir=whole", cwd=home)
    done, number = 0, 0
    while done < kills:
        folder, here = f"killed{number}", 0
        number += 1
        process = start("evaluate", *EVALUATE, f"run_dir={folder}", cwd=home)
        while here < 5 and done + here < kills and kill(process, random_.uniform(0.2, 0.9) * whole_s):
            here += 1
            if (home / folder / "config.yaml").exists():
                process = start("evaluate", f"resume={folder}", cwd=home)
            else:
                process = start("evaluate", *EVALUATE, f"run_dir={folder}", cwd=home)
        code, said = finish(process) if process.poll() is None else (process.returncode, "")
        trial = Trial("evaluate", "killed", here, wrong=int(code != 0), message=said)

        def faults(folder: str = folder) -> list[str]:
            read_rows(home / folder / "rows.csv")
            rows = rows_of(home / folder / "rows.csv")
            return ["other rows"] if rows != rows_of(home / "whole" / "rows.csv") else []

        done += here
        whole_s *= 1.0 if here else 0.8
        yield checked(trial, faults)


def killed_sweeps(home: Path, kills: int, random_: random.Random) -> Iterator[Trial]:
    """A sweep, its process killed with its jobs, and the same command again."""
    whole_s = time_of("train", *SWEEP, "sweep=whole", cwd=home)
    done, number = 0, 0
    while done < kills:
        name, here = f"sweep{number}", 0
        number += 1
        while here < 5 and done + here < kills:
            if not kill(start("train", *SWEEP, f"sweep={name}", cwd=home), random_.uniform(0.2, 0.9) * whole_s):
                break
            here += 1
        code, said = finish(start("train", *SWEEP, f"sweep={name}", cwd=home))

        def faults(name: str = name) -> list[str]:
            folders = sorted(path.parent for path in (home / "outputs" / "sweeps" / name).glob("*/config.yaml"))
            for folder in folders:
                load_model(folder)
            ended = [folder for folder in folders if read_record(folder / "done.json")]
            return [] if len(ended) == 2 else [f"{len(ended)} of 2 jobs ended"]

        done += here
        yield checked(Trial("sweep", "killed", here, wrong=int(code != 0), message=said), faults)


def killed_executions(home: Path, kills: int, random_: random.Random) -> Iterator[Trial]:
    """An execution that is killed leaves no half a report; the next one in its folder's place succeeds."""
    plan = f"plan={conf_dir() / 'plans' / 'fig7.json'}"
    whole_s = time_of("execute", plan, *EXECUTE, "run_dir=whole", cwd=home)
    done, number = 0, 0
    while done < kills:
        number += 1
        process = start("execute", plan, *EXECUTE, f"run_dir=run{number}", cwd=home)
        here = int(kill(process, random_.uniform(0.2, 0.9) * whole_s))
        done += here
        trial = Trial("execute", "killed", here)

        def faults(number: int = number) -> list[str]:
            read_record(home / f"run{number}" / "execution.json")
            return []

        yield checked(trial, faults)
    code, said = finish(start("execute", plan, *EXECUTE, "run_dir=last", cwd=home))
    yield Trial("execute", "started after these", wrong=int(code != 0), message=said)


def double_starts(home: Path, starts: int) -> Iterator[Trial]:
    """The same folder given to a second process while the first is at work."""
    for number in range(starts):
        command = ("train", "evaluate")[number % 2]
        given = (
            (*TRAIN, "training.max_episodes=1000000", "training.min_episodes=1000000")
            if command == "train"
            else EVALUATE
        )
        folder = f"double{number}"
        first = start(command, *given, f"run_dir={folder}", cwd=home)
        wait_for(home / folder / "config.yaml", first)
        second = start(command, *((f"resume={folder}",) if number % 4 < 2 else (*given, f"run_dir={folder}")), cwd=home)
        code, said = finish(second)
        if command == "train":
            first.send_signal(signal.SIGINT)
        first_code, first_said = finish(first)
        trial = Trial(command, "double start", message=f"{said}; {first_said}".strip("; "))
        trial.wrong += code != 2 or "Traceback" in said
        trial.lost += first_code != (130 if command == "train" else 0)
        yield trial


def bad_disks(home: Path) -> Iterator[Trial]:
    """Full and read-only disks: one line, and what was there before is whole."""
    commands: dict[str, tuple[str, ...]] = {
        "train": (*TRAIN, "run_dir=disk/run"),
        "evaluate": (*EVALUATE, "run_dir=disk/run"),
        "plan": ("planner=exact", "out=disk/plan.json"),
        "execute": (f"plan={conf_dir() / 'plans' / 'fig7.json'}", *EXECUTE, "run_dir=disk/run"),
    }
    cases = [(name, size) for name in commands for size in (4, 40)] + [("plan", 0), ("train", 0)]
    for number, (name, size) in enumerate(cases):
        cwd = home / f"case{number}"
        cwd.mkdir()
        with small_disk(cwd / "disk", size or 400) as disk:
            (disk / "kept.txt").write_text("here before")
            if not size:
                subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
            code, said = finish(start(name, *commands[name], cwd=cwd))
            trial = Trial(name, f"disk of {size} KiB" if size else "read-only disk", message=said)
            trial.wrong += code not in (0, 1, 2) or "Traceback" in said or (code != 0 and said.count("\n") > 0)
            trial.lost += (disk / "kept.txt").read_text() != "here before"
            for path in disk.rglob("*.json"):
                checked(trial, lambda path=path: [] if read_record(path) else ["an empty file"])  # type: ignore[misc]
        yield trial


@dataclass(frozen=True)
class Options:
    """out: the folder of the rows; kills, double: how many kills and double starts in all."""

    out: Path
    kills: int = 50
    double: int = 10
    seed: int = 0


def main(options: Options) -> None:
    """Make the trials and write the rows."""
    random_, tenth = random.Random(options.seed), -(-options.kills // 10)
    trials = []
    with tempfile.TemporaryDirectory() as home:
        parts = (
            lambda at: killed_trainings(at, 4 * tenth, random_),
            lambda at: killed_evaluations(at, 3 * tenth, random_),
            lambda at: killed_sweeps(at, 2 * tenth, random_),
            lambda at: killed_executions(at, tenth, random_),
            lambda at: double_starts(at, options.double),
            bad_disks,
        )
        for number, part in enumerate(tqdm(parts, unit="part")):
            at = Path(home) / str(number)
            at.mkdir()
            for trial in part(at):
                trials.append(trial)
                print(trial, flush=True)
    write_measurements(options.out / "kills", [asdict(trial) for trial in trials], seed=options.seed)
    print(f"{len(trials)} trials, lost: {sum(t.lost for t in trials)}, wrong: {sum(t.wrong for t in trials)}")


if __name__ == "__main__":
    sys.exit(run(main, Options))
