"""Daily test: the results of input checks and self-test, and how long they are valid.

Rules:
1. Passive: for each drive the state file keeps the times when its hand switch input was seen open
   and closed, and its STO active and released, in READY and FAULT. No request is needed: the
   operator releases the switch and presses the emergency stop once.
2. Active: the state file keeps the findings of `self_test.py` for every axis, with their time.
   They are valid for one robot file: another leg, or the empty machine, needs another test.
3. Both are valid for `valid_h`. A time in the future is not valid.
4. Both belong to one drive: another serial number needs another test.
5. UTC comes with the tick and is used for nothing else. The latest time ever read is kept too: a
   clock that is set back makes the results void, so that they are never valid for longer.
6. While the drives are enabled nothing of this is written: a write to a memory page that is being
   flushed to the disk waits for the disk.
"""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from gaitd_names import Finding, SelfTestDue, Untested
from msgspec.structs import replace

from daemon.core.exercises.self_test import AxisResult
from daemon.core.modes.persistent_state import (
    PersistentState,
    StoredAxisTest,
    StoredInputs,
    StoredSelfTest,
)
from drives.signals import Input

NS_PER_HOUR: Final = 3_600_000_000_000
STORE_NS: Final = 60_000_000_000
"""Interval at which the state file is updated with the time and with unchanged inputs."""
SLEW_NS: Final = 2_000_000_000
"""Backward step of a disciplined clock that does not count as set back."""


class Drive(NamedTuple):
    """What the daily test reads of the drive of one axis."""

    axis: str
    serial_number: int
    """0: unknown, before bring-up."""
    inputs: Input | None
    """Digital inputs of a sample of this cycle; None without one."""


class Clock(NamedTuple):
    """What the check of the clock has found."""

    newest_utc_ns: int
    """The latest time ever read."""
    back_s: float = 0.0
    """Time by which the clock was set back; 0: it was not."""


def check_clock(newest_utc_ns: int, utc_ns: int) -> Clock:
    """Compare the present time with the latest one ever read (rule 5)."""
    if utc_ns < newest_utc_ns - SLEW_NS:
        return Clock(utc_ns, (newest_utc_ns - utc_ns) * 1e-9)
    return Clock(max(newest_utc_ns, utc_ns))


def with_inputs(persistent: PersistentState, drive: Drive, utc_ns: int) -> PersistentState:
    """Store the state in which the inputs of a drive are (rule 1)."""
    if drive.inputs is None:
        return persistent
    stored = _stored_inputs(persistent, drive)
    closed = Input.HAND_SWITCH_CLOSED in drive.inputs
    released = Input.STO_RELEASED in drive.inputs
    updated = replace(
        stored,
        **{
            "hand_switch_closed_utc_ns" if closed else "hand_switch_open_utc_ns": utc_ns,
            "sto_released_utc_ns" if released else "sto_active_utc_ns": utc_ns,
        },
    )
    if not _has_changed(stored, updated):
        return persistent
    return replace(persistent, inputs={**persistent.inputs, drive.axis: updated})


def _stored_inputs(persistent: PersistentState, drive: Drive) -> StoredInputs:
    stored = persistent.inputs.get(drive.axis)
    if stored is None or _is_other_drive(drive, stored.serial_number):
        return StoredInputs(serial_number=drive.serial_number)
    return stored


def _is_other_drive(drive: Drive, serial_number: int) -> bool:
    """True if the drive has another serial number; it is 0 (unknown) before bring-up."""
    return drive.serial_number not in {0, serial_number}


def _has_changed(stored: StoredInputs, updated: StoredInputs) -> bool:
    return any(
        later - before > STORE_NS or later < before
        for before, later in zip(_times(stored), _times(updated), strict=True)
    )


def _times(stored: StoredInputs) -> tuple[int, int, int, int]:
    """Return the times in the order of `Untested`."""
    return (
        stored.hand_switch_open_utc_ns,
        stored.hand_switch_closed_utc_ns,
        stored.sto_active_utc_ns,
        stored.sto_released_utc_ns,
    )


def untested(
    persistent: PersistentState, drives: Sequence[Drive], utc_ns: int, valid_h: float
) -> tuple[tuple[str, Untested], ...]:
    """The axes and the states of their inputs that were not observed in time."""
    return tuple(
        (drive.axis, state)
        for drive in drives
        for state, seen_ns in zip(Untested, _times(_stored_inputs(persistent, drive)), strict=True)
        if not counts(seen_ns, utc_ns, valid_h)
    )


def due(
    stored: StoredSelfTest | None,
    drives: Sequence[Drive],
    leg_digest: str,
    utc_ns: int,
    valid_h: float,
) -> SelfTestDue:
    """The reason why a self-test must come before any motion (rule 2)."""
    if stored is None:
        return SelfTestDue.NOT_PASSED_TODAY
    if not stored.passed:
        return SelfTestDue.FAILED
    if stored.leg_digest != leg_digest:
        return SelfTestDue.OTHER_ROBOT_FILE
    if not counts(stored.utc_ns, utc_ns, valid_h):
        return SelfTestDue.TOO_OLD
    if any(drive.axis not in stored.axes for drive in drives):
        return SelfTestDue.OTHER_AXES
    if any(_is_other_drive(drive, stored.axes[drive.axis].serial_number) for drive in drives):
        return SelfTestDue.OTHER_DRIVE
    return SelfTestDue.NONE


def counts(seen_utc_ns: int, utc_ns: int, valid_h: float) -> bool:
    """True if a result from `seen_utc_ns` is still valid now (rule 3)."""
    age_ns = utc_ns - seen_utc_ns
    return seen_utc_ns > 0 and -SLEW_NS <= age_ns <= valid_h * NS_PER_HOUR


def stored_test(
    results: Sequence[AxisResult], serial_numbers: Mapping[str, int], leg_digest: str, utc_ns: int
) -> StoredSelfTest:
    """The note of a finished self-test; `serial_numbers` are those of the drives, by axis."""
    return StoredSelfTest(
        utc_ns=utc_ns,
        passed=all(one.fault is Finding.NONE for one in results),
        leg_digest=leg_digest,
        axes={
            one.name: StoredAxisTest(
                one.friction_si,
                one.friction_ratio,
                one.load_error_si,
                one.moved_si,
                serial_numbers[one.name],
            )
            for one in results
        },
    )
