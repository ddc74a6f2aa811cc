"""A training run as a user sees it: progress bar, logs, checkpoints, the best model, and how to resume."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from types import FrameType
from typing import Any, cast

from omegaconf import DictConfig, OmegaConf
from torchrl.record.loggers import Logger

from dore.app.build import MODEL
from dore.app.learning_keys import learning_keys
from dore.app.metrics import MetricsLog
from dore.app.run_folder import CHECKPOINT, mark_done
from dore.configure import make
from dore.draw.curves import draw_learning_curve
from dore.files import CURVE_FILE, METRICS_FILE
from dore.learn.checkpoint import BEST_NAME, MODEL_NAME, Tested, ipt_of, save_checkpoint, save_model
from dore.learn.evaluator import TestResult
from dore.learn.memory import memory_for
from dore.learn.trainer import Diverged, Progress, StopReason, Trainer
from dore.report.progress import ProgressBar


def _log_row(logger: Logger, row: Mapping[str, Any]) -> None:
    """A row of metrics.csv as TorchRL's loggers take it: its figures, by the steps of the environments."""
    for name, value in row.items():
        if value not in (None, "") and name not in ("iteration", "env_steps"):
            logger.log_scalar(f"train/{name}", float(value), step=int(row["env_steps"]))


BAR = "{l_bar}{bar}| {n_fmt}/{total_fmt} {unit} [{elapsed}<{remaining}{postfix}]"


class Session:
    """Runs a trainer in a run folder.

    Args:
        folder: claimed, its config written.
        cfg: the run's config.
        resumed: the trainer was loaded from the folder's checkpoint.
    """

    def __init__(self, trainer: Trainer, folder: Path, cfg: DictConfig, resumed: bool) -> None:
        self.trainer, self.folder = trainer, folder
        self.log_every: int = cfg.log_every
        self.capacity: int = cfg.buffer.storage.max_size
        self.checkpoint_s = 60 * cfg.checkpoint_minutes
        plain = cast(dict[str, Any], OmegaConf.to_container(cfg, resolve=True))
        self.learns = learning_keys(cfg)
        self.model_config = {name: plain[name] for name in (*MODEL, "seed")}
        progress = trainer.progress
        self._mark = (time.perf_counter(), progress.env_steps)
        self.best = BEST_NAME if trainer.budget.keep == "last" else MODEL_NAME
        if resumed:
            self._recall_best()
        self.metrics = MetricsLog(
            folder / METRICS_FILE, tuple(self._row(None)), progress.iteration if resumed else None
        )
        self.loggers: Mapping[str, Logger] = {name: make(node, f"logger {name}") for name, node in cfg.loggers.items()}
        for logger in self.loggers.values():
            if getattr(logger, "starts_over", False):
                for row in self.metrics.kept:
                    _log_row(logger, row)
        done, total, unit = trainer.way_to_end()
        self.bar = ProgressBar(initial=done, total=total, unit=unit, bar_format=BAR)
        self._stop = False
        self._saved_at = time.perf_counter()

    def run(self) -> StopReason:
        """Train to the end, or until asked to stop; leave a checkpoint either way.

        Raises:
            Diverged: names the last good checkpoint too.
        """
        before = {number: signal.signal(number, self._ask_to_stop) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            reason = self.trainer.run(self._report, lambda: self._stop)
            self._save_checkpoint()
        except Diverged as error:
            checkpoint = self.folder / CHECKPOINT
            good = f"the last good checkpoint is {checkpoint}" if checkpoint.exists() else "there is no checkpoint yet"
            raise Diverged(f"{error}; {good}") from None
        finally:
            for number_, handler in before.items():
                signal.signal(number_, handler)
            self.bar.close()
        self._conclude(reason)
        if self.trainer.progress.env_steps and self.metrics.path.exists():
            draw_learning_curve(self.folder / METRICS_FILE, self.folder / CURVE_FILE)
        return reason

    def _conclude(self, reason: StopReason) -> None:
        """Keep a model, the one that `training.keep` asks for, and record how the run ended.

        The model at the end of the budget is tested after the checkpoint is written: a run that is resumed with a
        larger budget is the same as one that had it from the start.
        """
        progress = self.trainer.progress
        if reason is StopReason.BUDGET:
            tested = self.trainer.run_test()
            self._keep_best(tested)
            self._log(progress, tested)
        if not (self.folder / MODEL_NAME).exists():
            self._save_model(MODEL_NAME)
        if reason is not StopReason.INTERRUPTED:
            mark_done(self.folder, {"stop_reason": str(reason), **asdict(progress)})

    def _ask_to_stop(self, signum: int, frame: FrameType | None) -> None:
        """Stop after this iteration; a second signal stops at once."""
        self._stop = True
        for number_ in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number_, self._stop_at_once)

    def _stop_at_once(self, signum: int, frame: FrameType | None) -> None:
        """Without a checkpoint: an exception here could break off a write, or surface as another one from torch."""
        print(f"\nstopped at once; {self.folder} can be resumed from its last checkpoint, if any", file=sys.stderr)
        os._exit(128 + signal.SIGINT)

    def _report(self, progress: Progress, tested: TestResult | None) -> None:
        self.bar.n, self.bar.total, self.bar.unit = self.trainer.way_to_end()
        if progress.filled and not progress.env_steps:
            self._show(f"filling the replay: {progress.filled:,} of {self.trainer.to_fill:,} transitions")
        if tested is not None:
            self._keep_best(tested)
        if tested is not None or (progress.env_steps and progress.iteration % self.log_every == 0):
            self._log(progress, tested)
        if time.perf_counter() - self._saved_at > self.checkpoint_s:
            self._save_checkpoint()

    def _show(self, how: str, before: str = "") -> None:
        """Show progress: on the bar, or as a line now and then, which starts with `before`."""
        self.bar.set_postfix_str(how)
        if self.bar.due() is not None:
            print(f"{before}{how}", flush=True)

    def _keep_best(self, tested: TestResult) -> None:
        """The weights of the best IPT so far, so that a killed run leaves a model too."""
        progress = self.trainer.progress
        if progress.best_cost is None or tested.cost <= progress.best_cost:
            progress.best_success, progress.best_cost = tested.success, tested.cost
            self._save_model(self.best, Tested(tested.success, tested.cost))

    def _recall_best(self) -> None:
        """The best model may be better than the checkpoint knows: it was kept after it, or by the run's last test."""
        progress, kept = self.trainer.progress, ipt_of(self.folder / self.best)
        if kept is not None and (progress.best_cost is None or kept.cost < progress.best_cost):
            progress.best_success, progress.best_cost = kept

    def _row(self, tested: TestResult | None) -> dict[str, float | None]:
        """A row of metrics.csv; where there are several worlds, with what an IPT measured on each."""
        progress, (then, steps_then) = self.trainer.progress, self._mark
        rate = (progress.env_steps - steps_then) / max(time.perf_counter() - then, 1e-9)
        row: dict[str, float | None] = {
            "iteration": progress.iteration,
            "env_steps": progress.env_steps,
            "episodes": progress.episodes,
            "updates": progress.updates,
            "seconds": round(progress.seconds, 3),
            "epsilon": progress.epsilon,
            "loss": progress.loss if progress.updates else None,
            "success": tested.success if tested else None,
            "rearrangements": tested.rearrangements if tested else None,
            "target_success": self.trainer.target_success,
            "env_steps_per_s": round(rate, 1),
        }
        if len(self.trainer.worlds) > 1:
            for column in ("success", "rearrangements"):
                for name in self.trainer.worlds:
                    row[f"{column}_{name}"] = getattr(tested.by_world[name], column) if tested else None
        return row

    def _log(self, progress: Progress, tested: TestResult | None) -> None:
        row = self._row(tested)
        self._mark = (time.perf_counter(), progress.env_steps)
        self.metrics.write(row)
        for logger in self.loggers.values():
            _log_row(logger, row)
        success = "-" if progress.success is None else f"{100 * progress.success:.1f}"
        done, total, unit = self.trainer.way_to_end()
        self._show(
            f"success {success} of {100 * self.trainer.target_success:g}%, eps {progress.epsilon:.2f}, "
            f"loss {progress.loss:.3g}, {row['env_steps_per_s']:,.0f} steps/s",
            before=f"{done:,g} of {total:,g} {unit} in {progress.seconds:.0f} s: ",
        )

    def _save_checkpoint(self) -> None:
        self.trainer.check_weights()
        with memory_for("buffer.storage.max_size", self.capacity):
            save_checkpoint(self.folder / CHECKPOINT, {**self.trainer.state_dict(), "learns": self.learns})
        if self.trainer.budget.keep == "last":
            self._save_model(MODEL_NAME)
        self._saved_at = time.perf_counter()

    def _save_model(self, name: str, tested: Tested | None = None) -> None:
        save_model(self.folder / name, self.trainer.learner.averaged.weights(), self.model_config, tested)
