"""Many executions one after the other: the environment is kept, and its objects are exchanged."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import Any

from dore.errors import InputError
from dore.sim.config import Body
from dore.sim.motion.outcome import Refused
from dore.sim.run.execution import Loop, check_reach, conduct
from dore.sim.run.report import ExecutionReport
from dore.sim.run.setup import Setup
from dore.world.layout import Layout


class Workcell:
    """An arm before one layout, which carries out loop after loop. It writes and films nothing.

    setup: of every execution, but for its seed.

    `reach`: what the arm can do on the layout, which plans have to be made with.

    Raises:
        InputError: cells of the layout are out of the arm's reach, or the arm's description is missing or wrong.
    """

    def __init__(self, setup: Setup, layout: Layout) -> None:
        self.setup, self.reach = replace(setup, film=False), setup.reach(layout)
        try:
            check_reach(self.reach, setup)
        except Refused as refusal:
            raise InputError(f"layout: {refusal.reason}, want one that arm={setup.arm.name} reaches") from None
        self._env: Any = None

    def carry_out(self, loop: Loop, seed: int) -> ExecutionReport:
        """As `run_loop` with that seed: the same outcome, and the same figures to a hundredth of a millimetre.

        PhysX orders contacts by what stood there before, so the last digits may differ.

        Raises:
            InputError: the loop cannot begin with this setup, or is for another reach.
        """
        if loop.problem.reach is not self.reach:
            raise InputError("problem.reach: another one, want the workcell's own")
        setup = self.setup.reseeded(seed)
        loop.check(setup)
        return conduct(loop, setup, self._environment, None, reach_known=True)

    def close(self) -> None:
        """Close the environment."""
        if self._env is not None:
            self._env.close()
            self._env = None

    def _environment(self, bodies: tuple[Body, ...], backend: str) -> AbstractContextManager[Any]:
        if self._env is None:
            self._env = self.setup.environment(self.reach.layout, bodies, backend)
        return nullcontext(self._env)
