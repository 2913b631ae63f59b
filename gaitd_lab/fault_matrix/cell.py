"""One cell: a fault injected into a session in its column's mode, and the measured reaction.

The service runs as its process would: by `Loop.run`, with its exit code. A core that has died or
ended with a bug is restarted when the fault is over, as systemd does.
"""

import math
import random
from contextlib import suppress
from itertools import pairwise
from typing import Final, NamedTuple

import msgspec
from gaitd_names import Cause, ExitCode, Mode

from daemon.config.limit_settings import Limits
from daemon.ipc.record import CycleRecord, Verdict
from gaitd_lab.fault_matrix import watch
from gaitd_lab.fault_matrix.faults import Fault
from gaitd_lab.fault_matrix.kinds import KilledError, Scene
from gaitd_lab.fault_matrix.modes import Column
from gaitd_lab.fault_matrix.watch import CYCLE_NS, StopFrames, Watch
from gaitd_lab.lockstep import LockstepSession

NS_PER_S: Final = 1_000_000_000
AFTERWARDS_S: Final = 1.2
"""Observation time after the fault has ended."""
WATCHED_S: Final = 1.8
"""Least observation time from the fault on."""
ALIVE_CYCLES: Final = 3
"""Tolerance between the drives' own stops: each drive's watchdog has this resolution."""


class Cell(NamedTuple):
    """The names that identify one cell."""

    fault: str
    mode: str
    axis: str
    """Empty for a fault that belongs to no axis."""


class CellResult(msgspec.Struct, frozen=True, kw_only=True):
    """The result of one cell, with the drawn values that are needed to run it again."""

    fault: str
    mode: str
    axis: str
    """Empty for a fault that belongs to no axis."""
    seed: int
    phase: float = -1.0
    """Phase of the stride at the fault; -1 if no gait is running."""
    driven: bool = False
    """True if a drive was enabled when the fault began."""
    stopped: bool = False
    """True if the service or the drives stopped."""
    causes: tuple[str, ...] = ()
    """Each cause latched or reported since the fault, in order."""
    category: str = ""
    """Category of the first stop."""
    drive: str = ""
    final_mode: str = ""
    final_cause: str = ""
    told_cycles: float | None = None
    """Cycles until the last axis's first stopping frame; None: none was sent."""
    left_cycles: float | None = None
    """Cycles until no drive is in operation enabled."""
    rest_cycles: float | None = None
    hip_deg: float = 0.0
    slide_mm: float = 0.0
    together: bool = True
    enabled_anew: tuple[str, ...] = ()
    lost_power: tuple[str, ...] = ()
    """Drives that switched their power stage off."""
    powerless_at_once: tuple[str, ...] = ()
    """Drives whose first stopping frame switched the power stage off, while they were enabled."""
    active_again: bool = False
    beyond_hip_deg: float = 0.0
    """Largest excess over the limits of limits.toml."""
    beyond_slide_mm: float = 0.0
    exit_code: int | None = None
    trouble: str = ""
    """An exception: a bug of the service or of the matrix."""

    @property
    def cell(self) -> Cell:
        """The cell of this result."""
        return Cell(self.fault, self.mode, self.axis)


class _OverError(BaseException):
    """The cell's observation time is over. Must not be caught by handlers of the service."""


def play_cell(
    session: LockstepSession, column: Column, fault: Fault, axis: str, seed: int
) -> CellResult:
    """Inject a fault into the present session, and observe the reaction."""
    rng = random.Random(f"{seed}/{fault.name}/{column.name}/{axis}")
    if column.prelude is not None:
        column.prelude(session)
    show = _RunningCell(session, column, fault, axis)
    show.plan(session.world_ns + rng.randrange(round(column.after_s * NS_PER_S)))
    show.run()
    return show.result(seed)


class _RunningCell:
    """One running cell."""

    def __init__(self, session: LockstepSession, column: Column, fault: Fault, axis: str) -> None:
        self._session = session
        self._column = column
        self._fault = fault
        self._axis = axis
        self._scene = Scene(session)
        self._begun_ns = self._gone_ns = self._end_ns = 0
        self._watch = Watch(session)
        self._records: list[CycleRecord] = []
        """Records since the fault, of all cores."""
        self._phase = -1.0
        self._driven = False
        self._exit_code: int | None = None
        self._trouble = ""
        self._mode = Mode.OFF
        """Mode of the newest record before the fault."""
        self._verdict = Verdict()

    def plan(self, begun_ns: int) -> None:
        """Schedule the fault's begin and end."""
        self._begun_ns = begun_ns
        self._gone_ns = begun_ns + round(self._fault.lasts_s * NS_PER_S)
        watched_s = max(self._fault.lasts_s + AFTERWARDS_S, WATCHED_S)
        self._end_ns = begun_ns + round(watched_s * NS_PER_S)
        self._session.bus.at(self._begun_ns, self._begin)
        self._session.bus.at(self._gone_ns, self._end)

    def _begin(self) -> None:
        session = self._session
        if session.records:
            newest = session.record
            self._phase, self._mode, self._verdict = newest.gait_phase, newest.mode, newest.verdict
        states = self._watch.samples[-1].states
        self._driven = watch.PUSHING in states
        self._fault.play.begin(self._scene, self._axis)

    def _end(self) -> None:
        self._fault.play.end(self._scene, self._axis)
        if self._column.release is not None:
            self._column.release(self._session)

    # --- the processes ------------------------------------------------------------------------

    def run(self) -> None:
        """Run the core's process, and what follows its end."""
        self._live()
        session = self._session
        if self._exit_code is not None and session.world_ns < self._end_ns:
            self._outlive()

    def _live(self) -> None:
        session = self._session
        seen = len(session.records)
        try:
            code = session.loop.run(self._end_requested)
        except _OverError:
            code = None
        except KilledError:
            code = -9
        self._records += session.records[seen:]
        bug = session.loop.bug
        if bug is not None:
            self._trouble = f"{type(bug).__name__}: {bug}"
        if code is not None:
            self._exit_code = int(code)

    def _outlive(self) -> None:
        """Run the drives alone, then a new core if this one did not end on request."""
        session = self._session
        anew = self._exit_code not in {ExitCode.DONE, ExitCode.DRIVE}
        until_ns = max(self._gone_ns, session.world_ns) if anew else self._end_ns
        while session.world_ns < until_ns:
            session.bus.trouble.is_gone = False
            with suppress(KilledError):  # of a core that has already ended
                session.bus.let_pass(until_ns)
        session.bus.trouble.is_gone = False
        if anew:
            self._scene.undo.clear()
            session.restart_core()
            code, self._exit_code = self._exit_code, None
            self._live()
            self._exit_code = code

    def _end_requested(self) -> bool:
        if self._session.world_ns >= self._end_ns:
            raise _OverError
        return self._scene.asked_to_end

    # --- measurements -------------------------------------------------------------------------

    def result(self, seed: int) -> CellResult:
        """Return the measurements of the cell."""
        session, begun_ns = self._session, self._begun_ns
        records = [one for one in self._records if one.sync_mono_ns >= begun_ns]
        stop = watch.first_stop(records)
        samples = [one for one in self._watch.samples if one.time_ns >= begun_ns]
        frames = self._stop_frames(stop)
        moved = watch.motion(samples, begun_ns, _standstill(session.settings.limits))
        beyond = watch.outside(samples, *_range(session.settings.limits))
        told_ns = [one for one in frames.told_ns if one is not None]
        left_ns = [one for one in watch.left_enabled(samples, begun_ns) if one is not None]
        verdicts = _verdicts(records, self._verdict)
        stopped = bool(self._driven and (told_ns or self._dropped(samples)))
        return CellResult(
            fault=self._fault.name,
            mode=self._column.name,
            axis=self._axis,
            seed=seed,
            phase=round(self._phase, 3),
            driven=self._driven,
            stopped=stopped,
            causes=tuple(dict.fromkeys(one.cause.name for one in verdicts)),
            category=verdicts[0].category.name if verdicts else "",
            drive=verdicts[0].drive if verdicts else "",
            final_mode=records[-1].mode.name if records else "",
            final_cause=records[-1].verdict.cause.name if records else "",
            told_cycles=_cycles(max(told_ns) - begun_ns) if told_ns else None,
            left_cycles=_cycles(max(left_ns) - begun_ns) if stopped and left_ns else None,
            rest_cycles=None if moved.rest_ns is None else _cycles(moved.rest_ns),
            hip_deg=round(moved.hip_deg, 2),
            slide_mm=round(moved.slide_mm, 1),
            together=self._together(frames, samples),
            enabled_anew=watch.enabled_again(samples, self._watch.axes),
            lost_power=watch.lost_power(samples, self._watch.axes),
            powerless_at_once=self._powerless(frames, samples),
            active_again=_active_again(records),
            beyond_hip_deg=round(math.degrees(beyond[0]), 2),
            beyond_slide_mm=round(beyond[1] * 1e3, 1),
            exit_code=self._exit_code,
            trouble=self._trouble,
        )

    def _stop_frames(self, stop: CycleRecord | None) -> StopFrames:
        nodes = {drive.name: drive.node_id for drive in self._session.settings.drives}
        stopped_ns = None
        if stop is not None and self._mode.active:
            stopped_ns = stop.sync_mono_ns + self._session.bus.behind_ns
        return watch.stop_frames(self._session.bus.sent, nodes, self._begun_ns, stopped_ns)

    def _powerless(self, told: StopFrames, samples: list[watch.Sample]) -> tuple[str, ...]:
        left_ns = watch.left_enabled(samples, self._begun_ns)
        return tuple(
            axis
            for axis, told_ns, gone_ns in zip(self._watch.axes, told.told_ns, left_ns, strict=True)
            if axis in told.powerless and told_ns is not None
            if gone_ns is None or gone_ns >= told_ns
        )

    def _dropped(self, samples: list[watch.Sample]) -> bool:
        """Return whether a drive that was enabled is not any more."""
        left = watch.left_enabled(samples, self._begun_ns)
        first = samples[0].states
        return any(
            state is watch.PUSHING and gone is not None
            for state, gone in zip(first, left, strict=True)
        )

    def _together(self, told: StopFrames, samples: list[watch.Sample]) -> bool:
        if None not in told.told_ns:
            return told.together
        if samples[0].states.count(watch.PUSHING) < len(self._watch.axes):
            return True
        left_ns = watch.left_enabled(samples, self._begun_ns)
        gone_ns = [one for one in left_ns if one is not None]
        if len(gone_ns) < len(left_ns):
            return not gone_ns
        return max(gone_ns) - min(gone_ns) <= ALIVE_CYCLES * CYCLE_NS


def _cycles(duration_ns: int) -> float:
    return round(duration_ns / CYCLE_NS, 1)


def _standstill(limits: Limits) -> watch.Pair:
    return limits.stop.hip.standstill_rad_per_s, limits.stop.slide.standstill_m_per_s


def _range(limits: Limits) -> tuple[watch.Pair, watch.Pair]:
    hip, slide = limits.hip, limits.slide
    return (
        (math.radians(hip.position_min_deg), slide.position_min_m),
        (math.radians(hip.position_max_deg), slide.position_max_m),
    )


def _verdicts(records: list[CycleRecord], before: Verdict) -> list[Verdict]:
    """Return each new verdict, in order."""
    results: list[Verdict] = []
    for one in records:
        if one.verdict != before and one.verdict.cause != Cause.NONE:
            results.append(one.verdict)
        before = one.verdict
    return results


def _active_again(records: list[CycleRecord]) -> bool:
    """Return whether an inactive mode was followed by an active one."""
    modes = [one.mode for one in records]
    return any(after.active and not before.active for before, after in pairwise(modes))
