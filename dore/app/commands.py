"""What dore-train, dore-evaluate and dore-plan do with a composed config; each returns the exit code."""

from __future__ import annotations

import logging
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig, open_dict

from dore.app import build, run_folder
from dore.app.session import CURVE, Session
from dore.app.training import trainer_of
from dore.draw.boards import draw_plan
from dore.errors import InputError, path_of, seed_of
from dore.files import locked
from dore.learn.checkpoint import SHIPPED, load_checkpoint, load_model
from dore.learn.trainer import Diverged, StopReason, Trainer
from dore.memory import OutOfMemory
from dore.planners.base import Planner
from dore.report import tables
from dore.report.evaluation import ROWS, Timing, evaluate_into, read_rows
from dore.world.files import read_scene, write_plan
from dore.world.instances import InstanceSet, random_problem
from dore.world.plan import Plan, PlanFile, Status
from dore.world.problem import Batch, Problem, cell_id

OK, FAILED, UNSOLVABLE, GAVE_UP, STOPPED = 0, 1, 3, 4, 130

logging.getLogger("torchrl").setLevel(logging.WARNING)


def train(cfg: DictConfig) -> int:
    """Train a new run, or go on with one."""
    if cfg.resume is not None:
        folder = path_of("resume", cfg.resume)
        return _go_on(folder, _resumed_config(folder))
    if cfg.existing not in ("refuse", "continue"):
        raise InputError(f"existing: got {cfg.existing!r}, want refuse or continue")
    folder = path_of("run_dir", cfg.run_dir)
    if cfg.existing == "continue" and (folder / run_folder.CHECKPOINT).exists():
        run_folder.check_same(folder, cfg)
        if run_folder.finished(folder, cfg.training):
            print(f"{folder}: finished already")
            return OK
        was = run_folder.read_config(folder)
        was.training = cfg.training
        return _go_on(folder, _placed(was, folder))
    if cfg.existing == "continue":
        run_folder.clear_unstarted(folder)
    trainer = trainer_of(cfg)
    with run_folder.claimed(folder, worth=run_folder.CHECKPOINT):
        run_folder.write_config(folder, cfg)
        return _run(Session(trainer, folder, cfg, resumed=False))


def _go_on(folder: Path, cfg: DictConfig) -> int:
    """Go on with a run from its checkpoint, under a config that differs from its own in the budget alone."""
    with locked(folder, "resume"):
        return _go_on_alone(folder, cfg)


def _go_on_alone(folder: Path, cfg: DictConfig) -> int:
    trainer = trainer_of(cfg)
    checkpoint = folder / run_folder.CHECKPOINT
    state = load_checkpoint(checkpoint)
    try:
        trainer.load_state_dict(state)
    except OutOfMemory:
        raise
    except (RuntimeError, KeyError, ValueError, TypeError) as error:
        why = str(error).splitlines()[0]
        raise InputError(f"{checkpoint}: of another layout, network or version ({why})") from None
    if trainer.spent() and (folder / run_folder.DONE).exists():
        done = trainer.progress
        print(f"{folder}: {done.episodes} episodes and {done.seconds:.0f} s are spent; training.max_episodes=... adds")
        return OK
    run_folder.unmark_done(folder)
    run_folder.write_config(folder, cfg)
    return _run(Session(trainer, folder, cfg, resumed=True))


def _run(session: Session) -> int:
    folder = session.folder
    print(f"training in {folder}", flush=True)
    try:
        reason = session.run()
    except Diverged as error:
        print(f"dore-train: {error}", file=sys.stderr)
        return FAILED
    if reason is StopReason.INTERRUPTED:
        print(f"stopped; go on with: dore-train resume={folder}")
        return STOPPED
    progress = session.trainer.progress
    if not progress.updates:
        print(f"{reason}: nothing was learned: {_before_the_first_update(session.trainer)}")
        print(f"go on with: dore-train resume={folder} training.max_minutes=...")
        return OK
    success = "no test was run" if progress.success is None else f"IPT success {100 * progress.success:.1f} %"
    print(f"{reason}: {success} after {progress.episodes} episodes in {progress.seconds:.0f} s")
    print(f"model, {run_folder.METRICS} and {CURVE} are in {folder}")
    return OK


class Evaluation(NamedTuple):
    """What dore-evaluate runs, built and checked."""

    planners: list[Planner]
    instances: InstanceSet
    timing: Timing

    @classmethod
    def of(cls, cfg: DictConfig) -> Evaluation:
        """Build it; `cfg` then names its whole world, and no longer hangs on what the model's file says."""
        build.use_threads(cfg.threads)
        if cfg.split not in ("test", "validation"):
            raise InputError(f"split: got {cfg.split!r}, want test or validation")
        if cfg.timing not in tuple(Timing):
            raise InputError(f"timing: got {cfg.timing!r}, want one of {', '.join(Timing)}")
        world = build.world_of(cfg, _model_config(cfg))
        reach = build.reach_of(world, cfg.device)
        splits = build.splits_of(world, reach)
        planners = build.planners_of(cfg, reach)
        instances: InstanceSet = splits.test(reach) if cfg.split == "test" else splits.validation(reach)
        if cfg.limit is not None:
            instances = instances.first(cfg.limit)
        with open_dict(cfg):
            cfg.merge_with(world)
        return cls(planners, instances, Timing(cfg.timing))


def evaluate(cfg: DictConfig) -> int:
    """Run planners on a split, or go on with that, and print the tables made from its rows.csv."""
    if cfg.resume is not None:
        folder = path_of("resume", cfg.resume)
        cfg = _evaluated_config(folder)
        evaluation = Evaluation.of(cfg)
    else:
        evaluation = Evaluation.of(cfg)
        with run_folder.claimed(_evaluation_dir(cfg), worth=run_folder.CONFIG) as folder:
            run_folder.write_config(folder, cfg)
    if not (folder / ROWS).exists():
        try:
            evaluate_into(folder, *evaluation)
        except KeyboardInterrupt:
            print(f"stopped; go on with: dore-evaluate resume={folder}")
            return STOPPED
    rows = read_rows(folder / ROWS)
    print(tables.as_text(tables.summary_table(tables.summarise(rows))))
    if len(evaluation.planners) > 1:
        print()
        print(tables.as_text(tables.paired_table(tables.compare(rows))))
    print(f"{ROWS} is in {folder}; timing={cfg.timing}, threads={cfg.threads}")
    return OK


def plan(cfg: DictConfig) -> int:
    """Plan one scene; write the plan, draw it, and print it."""
    build.use_threads(cfg.threads)
    out = path_of("out", cfg.out)
    picture = out.with_suffix(".png") if cfg.picture is None else path_of("picture", cfg.picture)
    world = build.world_of(cfg, _model_config(cfg))
    if cfg.scene == "random":
        reach = build.reach_of(world, cfg.device)
        difficulty = build.splits_of(world, reach).difficulty
        problem = random_problem(reach, difficulty, seed_of("seed", cfg.seed))
    else:
        scene = read_scene(path_of("scene", cfg.scene))
        problem = Problem(scene, build.reach_of(world, cfg.device, scene.layout))
    (found,) = build.planner_of(cfg, problem.reach).plan(Batch.of(problem))
    write_plan(out, PlanFile(problem, found))
    try:
        draw_plan(problem, found, picture)
    except OSError:
        out.unlink()
        raise
    _print_plan(found, cell_id(problem.scene.target))
    print(f"plan: {out}  picture: {picture}")
    return {Status.SOLVED: OK, Status.UNSOLVABLE: UNSOLVABLE, Status.GAVE_UP: GAVE_UP}[found.status]


def _print_plan(found: Plan, target_id: int) -> None:
    why = f" ({found.reason})" if found.reason else ""
    print(f"{found.status}{why} by {found.planner} in {1000 * found.planning_s:.1f} ms, {len(found.moves)} moves")
    for number, move in enumerate(found.moves, 1):
        print(
            f"  {number}. {cell_id(move.pick):>3} to {cell_id(move.place):<3}"
            f"  pick from {move.pick_direction_deg:+.1f} deg, place from {move.place_direction_deg:+.1f} deg"
        )
    if found.target_direction_deg is not None:
        print(f"  then the target on {target_id}, from {found.target_direction_deg:+.1f} deg")


def _before_the_first_update(trainer: Trainer) -> str:
    """How far a run is that has not made an update."""
    progress, budget = trainer.progress, trainer.budget
    if progress.filled < trainer.to_fill:
        return f"the replay holds {progress.filled:,} of training.fill {trainer.to_fill:,} transitions"
    return f"{progress.env_steps:,} steps were played, training.learning_starts is {budget.learning_starts:,}"


def _evaluation_dir(cfg: DictConfig) -> Path:
    """The evaluation's folder: its own in a sweep, so that no two jobs share one."""
    settings = HydraConfig.get()
    if settings.mode is RunMode.MULTIRUN:
        cfg.run_dir = str(Path(settings.sweep.dir) / settings.sweep.subdir)
    return path_of("run_dir", cfg.run_dir)


def _evaluated_config(folder: Path) -> DictConfig:
    """An evaluation's own config, in which nothing may differ: rows of two kinds would lie in one file."""
    cfg = run_folder.read_config(folder, expected=(*build.WORLD, "planners", "split", "limit", "timing", "threads"))
    if changes := _changes():
        raise InputError(f"resume: {changes[0]} cannot be changed in {folder}")
    return cfg


def _changes() -> list[str]:
    """What the command line gives beside `resume`."""
    return [change for change in HydraConfig.get().overrides.task if not change.startswith("resume=")]


def _resumed_config(folder: Path) -> DictConfig:
    """The run's own config; of what the command line gives, only the budget may differ."""
    cfg = run_folder.read_config(folder, expected=run_folder.LEARNING)
    changes = _changes()
    for change in changes:
        if change.split("=")[0].lstrip("+~") not in run_folder.SPENDING:
            allowed = ", ".join(run_folder.SPENDING)
            raise InputError(f"resume: {change} cannot be changed in {folder}, only {allowed}")
    cfg.merge_with_dotlist(changes)
    return _placed(cfg, folder)


def _placed(cfg: DictConfig, folder: Path) -> DictConfig:
    """The config of a run that lies in `folder` now."""
    # The folder may have been moved, or named from elsewhere; loggers write where it is now.
    for node in cfg.loggers.values():
        for key, value in node.items():
            if value == cfg.run_dir:
                node[key] = str(folder)
    cfg.run_dir = str(folder)
    return cfg


def _model_config(cfg: DictConfig) -> Mapping[str, Any]:
    """What the given model was made with, or the one in the package."""
    return load_model(SHIPPED if cfg.model is None else path_of("model", cfg.model))[1]
