"""Reports to systemd and the journal: ready, watchdog, status, and the state after the end.

Rules:
1. READY=1 with the first record: the loop runs, in any state of the drives.
2. WATCHDOG=1 once for each cycle that was finished in time, also during a bring-up; the loop
   decides which. Nothing else feeds the watchdog.
3. STATUS= at once when mode, cause or drive changes; otherwise the progress line, rarely: each is a
   message on the system bus to every observer of the unit.
   A message that systemd cannot take is sent again in the next cycle, except WATCHDOG=1.
4. STOPPING=1 when a shutdown is requested. The last STATUS= describes the final state of the
   drives, and is shown by `systemctl status` until the next start.
"""

from typing import Final

from gaitd_names import Cause, ExitCode, Mode

from daemon.core.period import cycles
from daemon.core.runtime.loop_settings import Log, Supervisor
from daemon.core.runtime.texts import one_line, status_text, verdict_text
from daemon.core.state import Axis, Core
from daemon.core.steps.wanted import is_silenced
from daemon.ipc.record import CycleRecord
from drives.cia402.power_state import POWER_STAGE_OFF

PROGRESS_CYCLES: Final = cycles(5.0)
"""Cycles between two status lines that differ only in their progress."""
ERROR, WARNING, NOTICE, INFORMATIONAL = 3, 4, 5, 6
"""Priorities of syslog(3)."""


class Supervision:
    """Sends changes of state to systemd and the journal, each one once."""

    def __init__(self, supervisor: Supervisor, log: Log, shutdown_effect: str) -> None:
        self._supervisor = supervisor
        self._log = log
        self._shutdown_effect = shutdown_effect
        self._is_ready = False
        self._ends = False
        self._reported: tuple[Mode, Cause, str] | None = None
        self._status = ""
        self._status_cycle = 0
        self._is_due = True

    def feed(self) -> None:
        """Feed the watchdog: a cycle was finished in time."""
        self._supervisor.send("WATCHDOG=1")

    def report(self, record: CycleRecord) -> None:
        """Report changes in a published record."""
        reported = (record.mode, record.verdict.cause, record.verdict.drive)
        is_new = reported != self._reported
        if is_new:
            self._reported, self._is_due = reported, True
            status = status_text(record)
            self._log.write(status, priority_of(record), fields_of(record))
        if self._is_due or record.cycle - self._status_cycle >= PROGRESS_CYCLES:
            self._send_status(record)

    def _send_status(self, record: CycleRecord) -> None:
        """Send the status line; if systemd cannot take it, it is sent again in the next cycle."""
        status = status_text(record)
        ready = () if self._is_ready else ("READY=1",)
        if status != self._status and not self._supervisor.send(*ready, f"STATUS={status}"):
            return
        self._status, self._status_cycle = status, record.cycle
        self._is_ready, self._is_due = True, False

    def begin_end(self) -> None:
        """Report that a shutdown was requested; moving legs are stopped first."""
        if not self._ends:
            self._ends = True
            self._supervisor.send("STOPPING=1")

    def end(self, core: Core, code: ExitCode) -> None:
        """Report the end of the process and the final state of the drives."""
        self.begin_end()
        status = one_line(final_state_text(core, code, self._shutdown_effect))
        self._supervisor.send(f"STATUS={status}")
        priority = NOTICE if code == ExitCode.DONE else ERROR
        self._log.write(
            status, priority, {"GAITD_EVENT": "ended", "GAITD_EXIT_CODE": str(int(code))}
        )


# --- words ----------------------------------------------------------------------------------


def priority_of(record: CycleRecord) -> int:
    """Journal priority of a change of mode or cause."""
    if record.verdict.cause in {Cause.NONE, Cause.SHUTDOWN}:
        return NOTICE
    return ERROR if record.mode in {Mode.FAULT, Mode.STOPPING} else WARNING


def fields_of(record: CycleRecord) -> dict[str, str]:
    """Journal fields with mode, cycle, cause and drive of a record."""
    fields = {
        "GAITD_EVENT": "mode",
        "GAITD_MODE": record.mode,
        "GAITD_CYCLE": str(record.cycle),
    }
    if record.verdict.cause != Cause.NONE:
        fields["GAITD_CAUSE"] = record.verdict.cause
    if record.verdict.drive:
        fields["GAITD_DRIVE"] = record.verdict.drive
    return fields


def final_state_text(core: Core, code: ExitCode, shutdown_effect: str) -> str:
    """Text on the final state after the end: power, brakes, and the effect on the leg."""
    if code == ExitCode.UNAVAILABLE:
        return (
            "ended by a bug of ours: quick stops were sent, and the drives stop by themselves; "
            f"last seen: {_states(core)}"
        )
    verdict = verdict_text(core.verdict)
    why = f" ({verdict})" if verdict else ""
    if code == ExitCode.DRIVE:
        return f"ended: the drives were refused and nothing was enabled{why}"
    if core.drives is None:
        left = "was not touched" if core.verdict.cause == Cause.DRIVE_POWERED else "is not known"
        return f"ended without the drives: their power {left}{why}"
    held = [axis for axis in core.axes if _may_have_power(axis)]
    if held or is_silenced(core):
        return f"ended, but not every drive showed that it is without power: {_states(core)}{why}"
    braked = [axis.name for axis in core.axes if axis.limits.brake]
    brakes = f", {' and '.join(braked)} on the brake" if braked else ", no axis has a brake"
    return f"ended: all axes are at rest and without power{brakes}. {shutdown_effect}"


def _may_have_power(axis: Axis) -> bool:
    return axis.sensed.feedback is None or axis.sensed.feedback.power_state not in POWER_STAGE_OFF


def _states(core: Core) -> str:
    return ", ".join(
        f"{axis.name} "
        + (
            "unknown"
            if axis.sensed.feedback is None
            else axis.sensed.feedback.power_state.name.lower()
        )
        for axis in core.axes
    )
