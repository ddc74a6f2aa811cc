"""What dore-train does with a composed config: a new run, or one resumed from its checkpoint."""

from __future__ import annotations

import logging
import sys
from pathlib import Path

from omegaconf import DictConfig

from dore.app import run_folder
from dore.app.learning_keys import LEARNING, check_learns, check_same, learning_keys
from dore.app.run_folder import CHECKPOINT
from dore.app.session import Session
from dore.app.training import trainer_of
from dore.configure import leaves
from dore.errors import ExitCode, InputError, pasted, path_of
from dore.files import CURVE_FILE, DONE_FILE, METRICS_FILE, locked
from dore.learn.checkpoint import BEST_NAME, MODEL_NAME, load_checkpoint, load_model
from dore.learn.memory import NotEnoughMemory
from dore.learn.trainer import Diverged, StopReason, Trainer

logging.getLogger("torchrl").setLevel(logging.WARNING)


def train_command(cfg: DictConfig) -> int:
    """Train a new run, or resume one; the exit code."""
    if cfg.resume is not None:
        folder = path_of("resume", cfg.resume)
        return _resume(folder, _resumed_config(folder, cfg))
    folder = path_of("run_dir", cfg.run_dir)
    if cfg.existing == "continue" and (folder / CHECKPOINT).exists():
        check_same(folder, cfg)
        if run_folder.finished(folder, cfg.training):
            print(f"{folder}: finished already")
            return ExitCode.OK
        original = run_folder.read_config(folder)
        original.training = cfg.training
        return _resume(folder, _moved_to(folder, original))
    if cfg.existing == "continue":
        run_folder.clear_unstarted(folder)
    trainer = trainer_of(cfg)
    with run_folder.claimed(folder, keep_if=(CHECKPOINT, METRICS_FILE)):
        run_folder.write_config(folder, cfg)
        return _run(Session(trainer, folder, cfg, resumed=False))


def _resume(folder: Path, cfg: DictConfig) -> int:
    """Resume a run from its checkpoint, under a config that differs from its own in the budget alone."""
    with locked(folder, "resume"):
        trainer = trainer_of(cfg)
        _load(trainer, folder / CHECKPOINT, cfg)
        _check_models(folder, cfg)
        if trainer.spent() and (folder / DONE_FILE).exists():
            done = trainer.progress
            used = f"{done.episodes} episodes, {done.updates} updates and {done.seconds:.0f} s"
            print(f"{folder}: the budget is used up ({used}); {_resume_with(folder, trainer)}")
            return ExitCode.OK
        (folder / DONE_FILE).unlink(missing_ok=True)
        run_folder.write_config(folder, cfg)
        return _run(Session(trainer, folder, cfg, resumed=True))


def _load(trainer: Trainer, checkpoint: Path, cfg: DictConfig) -> None:
    state = load_checkpoint(checkpoint)
    # Those of version 0.1 do not say.
    check_learns(str(checkpoint), state.get("learns", {}), learning_keys(cfg))
    try:
        trainer.load_state_dict(state)
    except NotEnoughMemory:
        raise
    except (RuntimeError, KeyError, ValueError, TypeError) as error:
        why = str(error).splitlines()[0]
        raise InputError(f"{checkpoint}: from a different layout, network or version ({why})") from None


def _check_models(folder: Path, cfg: DictConfig) -> None:
    """Refuse a folder with another run's model: it would be kept as this run's best."""
    for path in (folder / BEST_NAME, folder / MODEL_NAME):
        if path.exists():
            its = load_model(path)[1]
            ours = {key: one for key, one in learning_keys(cfg).items() if key.split(".")[0] in its}
            check_learns(str(path), dict(leaves(its)), ours)


def _resumed_config(folder: Path, given: DictConfig) -> DictConfig:
    """The run's own config; of what the command line gives only the budget differs, as `first_checks` has seen to."""
    cfg = run_folder.read_config(folder, expected=LEARNING, known=map(str, given))
    cfg.merge_with_dotlist(run_folder.changes())
    return _moved_to(folder, cfg)


def _moved_to(folder: Path, cfg: DictConfig) -> DictConfig:
    """The config of a run whose folder may have been moved, or named from elsewhere; loggers write where it is now."""
    for node in cfg.loggers.values():
        for key, value in node.items():
            if value == cfg.run_dir:
                node[key] = str(folder)
    cfg.run_dir = str(folder)
    return cfg


def _run(session: Session) -> int:
    folder = session.folder
    print(f"training in {folder}", flush=True)
    try:
        reason = session.run()
    except Diverged as error:
        print(f"dore-train: {error}", file=sys.stderr)
        return ExitCode.FAILED
    if reason is StopReason.INTERRUPTED:
        print(f"stopped; resume with: dore-train {pasted('resume', folder)}")
        return ExitCode.STOPPED
    progress = session.trainer.progress
    if not progress.updates:
        print(f"{reason}: nothing was learned: {_before_the_first_update(session.trainer)}")
        print(_resume_with(folder, session.trainer))
        return ExitCode.OK
    success = "no test was run" if progress.success is None else f"IPT success {100 * progress.success:.1f} %"
    print(f"{reason}: {success} after {progress.episodes} episodes in {progress.seconds:.0f} s")
    print(f"model, {METRICS_FILE} and {CURVE_FILE} are in {folder}")
    return ExitCode.OK


def _resume_with(folder: Path, trainer: Trainer) -> str:
    """The command that continues a run whose budget is spent, with twice as much of it."""
    limit = trainer.nearest_limit
    twice = 2 * getattr(trainer.budget, limit)
    more = f"{limit}={twice:g}" if limit == "max_minutes" else f"{limit}={twice}"
    return f"resume with: dore-train {pasted('resume', folder)} training.{more}"


def _before_the_first_update(trainer: Trainer) -> str:
    """The progress of a run that has made no update yet."""
    progress, budget = trainer.progress, trainer.budget
    if progress.filled < trainer.to_fill:
        return f"the replay holds {progress.filled:,} of training.fill {trainer.to_fill:,} transitions"
    return f"{progress.env_steps:,} steps were played, training.learning_starts is {budget.learning_starts:,}"
