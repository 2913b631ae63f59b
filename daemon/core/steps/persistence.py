"""What outlives the core: poses, proven signs, the daily test, and a latched stop.

This file is the only writer of `persistent` and of what is derived from it. The loop writes the
state file when `persistent` has changed.
"""

from collections.abc import Sequence

from gaitd_names import Cause, EventCode, Finding, Mode
from msgspec.structs import replace

from daemon.core.exercises.self_test import SelfTest
from daemon.core.modes import daily_test, latched_stop
from daemon.core.modes.daily_test import Drive
from daemon.core.modes.persistent_state import (
    SignProof,
    proven,
    trusted,
    with_doubt,
    with_pose,
    with_proof,
    without_tests,
)
from daemon.core.safety.joints import is_at_rest
from daemon.core.state import Axis, Core
from daemon.core.steps import sensing
from daemon.ipc.record import Verdict
from drives.bringup.bringup import DriveReport
from drives.signals import Input


def store_poses(core: Core, utc_ns: int) -> None:
    """Store the pose of every axis that is followed and at rest with a sample of this cycle."""
    for axis in core.axes:
        if (
            axis.sensed.followed
            and axis.sensed.joint.fresh
            and is_at_rest(axis.sensed.joint, axis.limits)
        ):
            core.persistent = with_pose(
                core.persistent, axis.name, axis.sensed.joint.position_si, utc_ns
            )


# --- latched stop ---------------------------------------------------------------------------------


def update_latch(core: Core, utc_ns: int) -> None:
    """Update the latched verdict that a new core would find if this one ended now."""
    stored = core.persistent.latched
    latched = latched_stop.updated(stored, core.mode, core.verdict, utc_ns)
    if latched is not stored:
        core.persistent = replace(core.persistent, latched=latched)


def clear_latch(core: Core) -> None:
    """Remove the latched verdict from the state file."""
    if core.persistent.latched is not None:
        core.persistent = replace(core.persistent, latched=None)


# --- signs ----------------------------------------------------------------------------------------


def prove_sign(core: Core, axis: Axis, proof: SignProof) -> None:
    """Store the proof of an axis's sign."""
    core.persistent = with_proof(core.persistent, axis.name, proof)
    axis.sign_proven = True
    sensing.trust_sign(axis, trusted=axis.serial_number != 0)


def forget_other_drives(core: Core, reports: Sequence[DriveReport]) -> None:
    """Forget the tests of drives without a serial number that were out of sight; before `begin`."""
    for axis, report in zip(core.axes, reports, strict=True):
        if report.serial_number == 0 and axis.is_other_drive(report.serial_number):
            kept = without_tests(core.persistent, axis.name)
            if kept is not core.persistent:
                core.persistent = kept
                core.report(EventCode.TESTS_FORGOTTEN, axis.name)


def check_signs(core: Core) -> None:
    """Look up the proofs for the drives that have just been brought up."""
    for axis in core.axes:
        drive = axis.name, axis.wiring, axis.serial_number
        axis.sign_proven = proven(core.persistent, *drive)
        sensing.trust_sign(axis, trusted=trusted(core.persistent, *drive))


def store_sign_doubts(core: Core) -> None:
    """Store which proofs are in doubt: a later core does not trust those signs either."""
    for axis in core.axes:
        if axis.sign_proven and not axis.sensed.sign_trusted:
            core.persistent = with_doubt(core.persistent, axis.name, doubted=True)


def _trust_signs(core: Core) -> None:
    """Trust all proven signs: each axis has just moved both ways as it was told."""
    for axis in core.axes:
        if axis.sign_proven and axis.serial_number != 0:
            core.persistent = with_doubt(core.persistent, axis.name, doubted=False)
            sensing.trust_sign(axis, trusted=True)


# --- daily test -----------------------------------------------------------------------------------


def check_day(core: Core, utc_ns: int) -> None:
    """Check clock and inputs once a cycle, and update what the daily test still needs."""
    _check_clock(core, utc_ns)
    rules = core.config.self_test
    drives = _drives(core) if not core.mode.active or rules.required == "daily" else []
    if core.mode in {Mode.READY, Mode.FAULT}:
        for drive in drives:
            core.persistent = daily_test.with_inputs(core.persistent, drive, utc_ns)
    if rules.required == "daily":
        core.inputs_untested = daily_test.untested(core.persistent, drives, utc_ns, rules.valid_h)
        core.self_test_due = daily_test.due(
            core.persistent.self_test, drives, core.config.leg_digest, utc_ns, rules.valid_h
        )


def _drives(core: Core) -> list[Drive]:
    return [
        Drive(
            axis.name,
            axis.serial_number,
            axis.sensed.feedback.inputs
            if axis.sensed.feedback is not None
            and axis.sensed.feedback.fresh
            and Input.IMPOSSIBLE not in axis.sensed.feedback.inputs
            else None,
        )
        for axis in core.axes
    ]


def _check_clock(core: Core, utc_ns: int) -> None:
    persistent = core.persistent
    clock = daily_test.check_clock(max(core.utc_newest_ns, persistent.utc_newest_ns), utc_ns)
    core.utc_newest_ns = clock.newest_utc_ns
    if clock.back_s:
        if persistent.self_test is not None or persistent.inputs:
            core.report(EventCode.CLOCK_SET_BACK, "", clock.back_s)
        core.persistent = replace(persistent, self_test=None, inputs={}, utc_newest_ns=utc_ns)
    elif (
        not core.mode.active
        and clock.newest_utc_ns - persistent.utc_newest_ns > daily_test.STORE_NS
    ):
        core.persistent = replace(persistent, utc_newest_ns=clock.newest_utc_ns)


def finish_self_test(core: Core, utc_ns: int) -> Verdict | None:
    """Store and publish the findings of a finished self-test; returns a verdict if it failed."""
    results = [
        result
        for leg in core.legs
        if isinstance(leg.exercise, SelfTest)
        for result in leg.exercise.results()
    ]
    serial_numbers = {axis.name: axis.serial_number for axis in core.axes}
    stored = daily_test.stored_test(results, serial_numbers, core.config.leg_digest, utc_ns)
    core.persistent = replace(core.persistent, self_test=stored)
    for one in results:
        passed = one.fault is Finding.NONE
        code = EventCode.SELF_TEST_PASSED if passed else EventCode.SELF_TEST_FAILED
        numbers = one.friction_si, one.friction_ratio, one.load_error_si, one.moved_si
        core.report(code, one.name, *numbers, one.fault, one.value, one.limit)
    failed = next((one for one in results if one.fault is not Finding.NONE), None)
    if failed is None:
        _trust_signs(core)
        return None
    cause = Cause.SELF_TEST_FAILED
    category = core.config.categories.of(cause)
    return Verdict(category, cause, failed.name, failed.value, failed.limit, failed.fault)
