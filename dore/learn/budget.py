"""How long and how a run learns: the schedule of epsilon, and the settings of `training`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from dore.errors import number, one_of, whole
from dore.learn.averaging import decay_of

Precision = Literal["float32", "bfloat16"]
Keep = Literal["best", "last"]
Clock = Literal["wall", "cpu"]
Unit = Literal["round", "step", "episode"]
"""What is stored before the next updates: a step of all environments, a step of one, or a whole episode."""


@dataclass(frozen=True)
class LinearEpsilon:
    """Epsilon falls in a straight line over the first `anneal_steps` environment steps after the replay is filled.

    Raises:
        InputError: a share outside [0, 1], or fewer than one step.
    """

    start: float
    end: float
    anneal_steps: int

    def __post_init__(self) -> None:
        number("exploration.start", self.start, above=-1e-12, at_most=1.0)
        number("exploration.end", self.end, above=-1e-12, at_most=1.0)
        whole("exploration.anneal_steps", self.anneal_steps, 1)

    def __call__(self, env_steps: int) -> float:
        """Epsilon after `env_steps` environment steps."""
        done = min(1.0, env_steps / self.anneal_steps)
        return self.start + done * (self.end - self.start)


@dataclass(frozen=True)
class Budget:
    """When a run ends without passing, and how it learns on the way.

    min_episodes: before these no test ends the run: plans get shorter after success is high (paper: 0).
    max_episodes: T_lim. max_minutes, max_updates: of training, None for no limit; the round that reaches max_updates is
        the last one.
    clock: what minutes and seconds are counted by: the wall's clock, or the CPU time of this process, which is fair
        between runs on a busy machine.
    fill: transitions of uniformly random play that are stored before anything counts (Algorithm 2, line 1; Table 5's
        replay start size), in each world.
    learning_starts: transitions in a world's buffer before its first update.
    batch_size: transitions an update. update_after: see `Unit`. updates: made after each such unit.
    keep: the model that a run returns: that of the best IPT, or the last one (Algorithm 2, line 19).
    max_grad_norm: gradients are scaled down to this norm; None: never (the paper does not mention it).
    averaging: decay of the mean weights that the IPT acts by and that are kept (`AveragedWeights`); None: the
        weights as they are, as in the paper.
    precision: of the networks' multiplications while they learn; weights, errors and plans stay float32.
    lr_end: the share of the learning rate that is left when the budget is spent; it falls linearly (paper: 1).

    Raises:
        InputError: a number outside its domain, or no such precision.
    """

    min_episodes: int
    max_episodes: int
    max_minutes: float | None
    fill: int
    learning_starts: int
    batch_size: int
    update_after: Unit
    updates: int
    keep: Keep
    max_grad_norm: float | None
    averaging: float | None
    precision: Precision
    lr_end: float = 1.0  # Run folders of version 0.1 do not name it,
    clock: Clock = "wall"  # nor those of 0.2 these two.
    max_updates: int | None = None

    def __post_init__(self) -> None:
        for name in ("min_episodes", "fill"):
            whole(f"training.{name}", getattr(self, name), 0)
        for name in ("max_episodes", "batch_size", "learning_starts"):
            whole(f"training.{name}", getattr(self, name), 1)
        whole("training.updates", self.updates, 1, at_most=10_000)
        for name in ("max_minutes", "max_grad_norm"):
            if getattr(self, name) is not None:
                number(f"training.{name}", getattr(self, name), above=0.0)
        if self.max_updates is not None:
            whole("training.max_updates", self.max_updates, 1)
        decay_of(self.averaging)
        number("training.lr_end", self.lr_end, above=0.0, at_most=1.0)
        one_of("training.update_after", self.update_after, Unit)
        one_of("training.keep", self.keep, Keep)
        one_of("training.precision", self.precision, Precision)
        one_of("training.clock", self.clock, Clock)
