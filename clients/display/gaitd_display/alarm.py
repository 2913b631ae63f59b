"""The alarm of a page: when it sounds, and one identifier for each, which a page acknowledges.

It sounds for each stop with a cause, also one at rest, and if the signal is lost while the drives
are enabled. It does not for what a person does before a training: switching the machine on, and
pressing the emergency stop at rest where a session wants its daily test.
"""

from collections.abc import Iterable
from typing import Final, NamedTuple

from gaitd_client import Cause, DriveState, Safety

from gaitd_display.way_out import UNPOWERED_MODES

SIGNAL_LOST: Final = "no_signal"
INPUT_CYCLES: Final = 20
"""After so many cycles a drive has shown the input that goes with its fault."""
BY_EMERGENCY_STOP: Final = frozenset({Cause.DRIVE_FAULT, Cause.EMERGENCY})
"""Causes that the emergency stop has where nothing moves: the drive reports it as a fault."""


def cause_of(safety: Safety | None) -> str:
    """Return the cause of the latched stop; `Cause.NONE` without one."""
    verdict = None if safety is None else safety.verdict
    return Cause.NONE if verdict is None else verdict.cause


class _Stopped(NamedTuple):
    """How the present stop began."""

    cycle: int | None = None
    """When it was published; None: there is none."""
    is_active: bool = False
    """The drives were enabled."""
    has_emergency_stop: bool = False
    """A drive has read the emergency stop as pressed since then."""


class Alarm:
    """Counts the alarms of one server."""

    def __init__(self, run_id: str) -> None:
        """Start without an alarm.

        Args:
            run_id: differs with each start of the server, so that an alarm is never one of before.
        """
        self._run_id, self._count, self._about = run_id, 0, ""
        self._stopped = _Stopped()
        self._was_up = False
        self.was_active = False
        """The drives are enabled, or were when the trainer fell silent."""

    def is_by_emergency_stop(self, cause: str) -> bool:
        """Return whether a person has pressed the emergency stop, which has this other cause."""
        return self._stopped.has_emergency_stop and cause in BY_EMERGENCY_STOP

    def take(
        self, safety: Safety | None, drives: Iterable[DriveState], *, has_session: bool
    ) -> str | None:
        """Take the newest messages; return the identifier of the present alarm, or None.

        Args:
            safety: None: the trainer is silent.
            drives: those that are not silent.
            has_session: the trainer runs sessions, with the daily test of the emergency stop.
        """
        about = (
            self._about_silence()
            if safety is None
            else self._about_stop(safety, drives, has_session)
        )
        if about and about != self._about:
            self._count += 1
        self._about = about
        return f"{self._run_id}-{self._count}" if about else None

    def _about_silence(self) -> str:
        return SIGNAL_LOST if self.was_active else self._about

    def _about_stop(self, safety: Safety, drives: Iterable[DriveState], has_session: bool) -> str:
        drives = tuple(drives)
        cause = cause_of(safety)
        self._note(safety, cause, drives)
        return cause if cause != Cause.NONE and self._sounds(drives, has_session) else ""

    def _note(self, safety: Safety, cause: str, drives: tuple[DriveState, ...]) -> None:
        cycle, began_cycle = safety.cycle or 0, self._stopped.cycle
        if cause == Cause.NONE:
            self._stopped = _Stopped()
        elif began_cycle is None or cycle < began_cycle:
            # The first message of the stop; or of a core that has started again.
            self._stopped = _Stopped(cycle, is_active=self.was_active)
        if any(drive.sto_released is False for drive in drives):
            self._stopped = self._stopped._replace(has_emergency_stop=True)
        self.was_active = bool(safety.active)
        self._was_up |= safety.mode not in UNPOWERED_MODES

    def _sounds(self, drives: tuple[DriveState, ...], has_session: bool) -> bool:
        stopped = self._stopped
        if self._about or stopped.is_active:
            return True
        if not has_session:
            return self._was_up
        known_cycle = (stopped.cycle or 0) + INPUT_CYCLES
        is_known = all(drive.cycle >= known_cycle for drive in drives)
        return self._was_up and is_known and not stopped.has_emergency_stop
