"""A logger that fits a run's own folder."""

from __future__ import annotations

from pathlib import Path

from torchrl.record.loggers import TensorboardLogger


class TensorBoard(TensorboardLogger):
    """TorchRL's logger, which starts over whenever it is made: a resumed run writes its earlier rows again.

    So its curves have no point twice, and none that was logged after the checkpoint from which a run is resumed.
    """

    starts_over = True

    def __init__(self, exp_name: str, log_dir: str) -> None:
        for old in Path(log_dir, exp_name).glob("events.out.tfevents.*"):
            old.unlink()
        super().__init__(exp_name, log_dir)
