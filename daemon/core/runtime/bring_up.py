"""Attempts to bring up the drives: one a second while the core is in mode off."""

from collections.abc import Callable
from contextlib import closing
from typing import Final

from gaitd_names import Cause, Mode

from daemon.core.runtime.build import Plans
from daemon.core.runtime.bus_link import Line
from daemon.core.state import Core
from daemon.core.steps import supervisor
from daemon.core.steps.bring_up import bring_up_core
from daemon.system.clock import Clock
from drives.bringup.plan import CycleSettings
from drives.errors import BusError

RETRY_NS: Final = 1_000_000_000
"""Time between two attempts to bring up drives that do not answer."""


class BringUp:
    """The bring-up of a core's drives, and the time of its next attempt."""

    def __init__(
        self, core: Core, plans: Plans, settings: CycleSettings, line: Line, clock: Clock
    ) -> None:
        self._core = core
        self._plans = plans
        self._settings = settings
        self._line = line
        self._clock = clock
        self._retry_ns = 0

    @property
    def is_due(self) -> bool:
        """True in mode off, if the last attempt is long enough ago."""
        return self._core.mode == Mode.OFF and self._clock.now_ns() >= self._retry_ns

    def run(self, meanwhile: Callable[[], None]) -> bool:
        """Open the bus, and run all steps of the bring-up.

        Args:
            meanwhile: called often; runs a cycle without drives each 10 ms.

        Returns: False if the bus could not be opened.

        Raises:
            BringUpRefused: a drive is not the one in the configuration files, or refuses their
                values.
        """
        core, line = self._core, self._line
        self._retry_ns = self._clock.now_ns() + RETRY_NS
        try:
            line.open()
        except BusError as error:
            supervisor.fail_bring_up(core, Cause.BUS_DOWN, "", f"{error.channel}: {error.what}")
            return False
        port = line.port(requested=core.reset_cycles_left > 0, meanwhile=meanwhile)
        plans = self._plans.of(core.single_axis)
        # Closed whatever happens meanwhile: it leaves no drive with power then (bringup.py, rule 8)
        with closing(bring_up_core(core, plans, port, self._settings)) as steps:
            for _ in steps:
                meanwhile()
        self._retry_ns = self._clock.now_ns() + RETRY_NS
        if core.drives is not None:
            core.drives.bus_state = line.bus_state
        if core.verdict.cause == Cause.BUS_DOWN:
            line.close()
        return True

    def lose_bus(self, error: BusError) -> None:
        """Close the bus after an error in a cycle; the next attempt opens it again."""
        supervisor.lose_bus(self._core, f"{error.channel}: {error.what}")
        self._retry_ns = self._clock.now_ns() + RETRY_NS
        self._line.close()
