"""What dore-evaluate does with a composed config: planners on a split, their rows, and the tables made from them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from omegaconf import DictConfig, OmegaConf, open_dict

from dore.app import build, jobs, run_folder
from dore.errors import ExitCode, InputError, pasted, path_of
from dore.files import CONFIG_FILE, GROUPS_FILE, ROWS_FILE, conf_dir, locked, write_record
from dore.planners.base import Planner
from dore.report.evaluation import benchmark_rows, collect_rows, evaluate_into
from dore.report.rows import BenchmarkRow, ExecutedRow, Timing
from dore.report.tables import evaluation_tables
from dore.world.benchmark import Benchmark, BenchmarkSet
from dore.world.instances import InstanceSet

OF_AN_ARM = (
    *("objects", "view", "camera", "disturbance", "loop", "jitter_m", "turned", "limits", "seed", "workers", "backend"),
)
"""Keys that say how an arm carries plans out."""


class BenchmarkEvaluation(NamedTuple):
    """Planners on the benchmark, built and checked; each of its layouts and reaches has its own."""

    sets: Sequence[BenchmarkSet]
    planners: Sequence[Sequence[Planner]]
    timing: Timing

    @classmethod
    def of(cls, cfg: DictConfig, benchmark: Benchmark) -> BenchmarkEvaluation:
        """Build it; layouts and reaches are the benchmark's."""
        if cfg.split != "test":
            raise InputError(f"split: got {cfg.split}, want test: the benchmark has no other boards")
        if cfg.get("arm") is not None:
            raise InputError("instances: got benchmark, want another where an arm carries plans out")
        for name, key in (("layout", "layouts"), ("reach", "reaches")):
            if cfg.get(name) is not None:
                raise InputError(f"{name}: has no effect on instances=benchmark, want instances.{key}=[NAME]")
        with open_dict(cfg):
            cfg.layout = cfg.reach = None  # A run's config names its whole world.
        sets = benchmark.sets(cfg.limit, cfg.device)
        return cls(sets, [build.planners_of(cfg, one.instances.reach) for one in sets], Timing(cfg.timing))


class Evaluation(NamedTuple):
    """What dore-evaluate runs, built and checked."""

    planners: list[Planner]
    instances: InstanceSet
    timing: Timing

    @classmethod
    def of(cls, cfg: DictConfig) -> Evaluation:
        """Build it; `cfg` then names its whole world, and no longer depends on what the model's file says."""
        model = build.model_config(cfg)
        if cfg.get("arm") is not None:  # It may not reach the model's layout.
            model = {**model, "layout": OmegaConf.load(conf_dir() / "layout" / "3x6.yaml")}
        with open_dict(cfg):
            cfg.update(build.world_of(cfg, model))
            if cfg.get("arm") is not None:
                from dore.app.in_scene import own_reach  # Loads the simulator.

                cfg.reach = own_reach(cfg)
        reach = build.reach_of(cfg, cfg.device)
        splits = build.splits_of(cfg, reach)
        planners = build.planners_of(cfg, reach)
        instances: InstanceSet = splits.test(reach) if cfg.split == "test" else splits.validation(reach)
        if cfg.limit is not None:
            instances = instances.first(cfg.limit)
        return cls(planners, instances, Timing(cfg.timing))


def evaluation_of(cfg: DictConfig) -> Evaluation | BenchmarkEvaluation:
    """What `cfg` asks for, built and checked.

    Raises:
        InputError: names the key that is wrong.
    """
    build.use_threads(cfg.threads)
    if cfg.split not in ("test", "validation"):
        raise InputError(f"split: got {cfg.split!r}, want test or validation")
    if cfg.timing not in tuple(Timing):
        raise InputError(f"timing: got {cfg.timing!r}, want one of {', '.join(Timing)}")
    benchmark = build.benchmark_of(cfg)
    return Evaluation.of(cfg) if benchmark is None else BenchmarkEvaluation.of(cfg, benchmark)


def evaluate_command(cfg: DictConfig) -> int:
    """Evaluate planners on a split, or resume that, and print the tables made from its rows.csv; the exit code."""
    begun = run_folder.folder_of(cfg) if jobs.in_sweep() else None
    if cfg.resume is not None or (begun is not None and (begun / CONFIG_FILE).exists()):
        folder = path_of("resume", cfg.resume) if begun is None else begun
        cfg = _own_config(folder, cfg)
        with locked(folder, "resume"):
            return _evaluate(folder, evaluation_of(cfg), cfg)
    _check_keys_fit(cfg)
    evaluation = evaluation_of(cfg)
    with run_folder.claimed(run_folder.folder_of(cfg), keep_if=(CONFIG_FILE,)) as folder:
        cfg.run_dir = str(folder)
        run_folder.write_config(folder, cfg)
        if groups := build.groups_of(cfg):
            write_record(folder / GROUPS_FILE, groups)
        return _evaluate(folder, evaluation, cfg)


def _evaluate(folder: Path, evaluation: Evaluation | BenchmarkEvaluation, cfg: DictConfig) -> int:
    """Make the rows that are missing, and print the tables; this process has locked the folder."""
    if not (folder / ROWS_FILE).exists():
        try:
            if isinstance(evaluation, BenchmarkEvaluation):
                collect_rows(folder, BenchmarkRow, partial(benchmark_rows, *evaluation))
            elif cfg.get("arm") is None:
                evaluate_into(folder, *evaluation)
            else:
                from dore.app.in_scene import rows_of_scenes

                make_rows = partial(rows_of_scenes, cfg, evaluation.planners, evaluation.instances)
                collect_rows(folder, ExecutedRow, make_rows)
        except KeyboardInterrupt:
            print(f"stopped; resume with: dore-evaluate {pasted('resume', folder)}")
            return ExitCode.STOPPED
    print(evaluation_tables(folder))
    if isinstance(evaluation, Evaluation) and (n_open := evaluation.instances.n_accessible):
        print(f"{n_open} of {len(evaluation.instances)} targets are accessible at the start: solved in no move")
    print(f"{ROWS_FILE} is in {folder}; timing={cfg.timing}, threads={cfg.threads}")
    return ExitCode.OK


def _check_keys_fit(cfg: DictConfig) -> None:
    """Refuse what would be ignored: a reach beside the arm's own, and how to carry plans out where no arm does."""
    keys = run_folder.changed_keys()
    if cfg.get("arm") is not None and "reach" in keys:
        raise InputError(f"{keys['reach']}: plans are made with the arm's own reach, want none given")
    unused = [keys[key] for key in OF_AN_ARM if key in keys]
    if cfg.get("arm") is None and unused:
        raise InputError(f"{unused[0]}: has no effect unless an arm carries plans out, want arm=NAME too")


def _own_config(folder: Path, given: DictConfig) -> DictConfig:
    """An evaluation's own config, in which nothing may differ: rows of two kinds would be in one file."""
    return run_folder.read_config(
        folder,
        expected=(*build.WORLD, "planners", "split", "limit", "timing", "threads"),
        known=(*map(str, given), "arm"),
    )
