"""Bring-up of the drives from mode OFF to READY, with progress reported step by step."""

from collections.abc import Generator, Iterator, Sequence

from daemon.core.modes import table
from daemon.core.modes.persistent_state import disagreement, proven
from daemon.core.modes.table import Event
from daemon.core.state import Axis, Core
from daemon.core.steps import exercises, latching
from daemon.core.steps.joints import Joint
from daemon.ipc.record import Cause, Mode, Verdict
from drives.bringup.bringup import DriveReport, Progress, bring_up
from drives.bringup.plan import CycleSettings, DrivePlan
from drives.bringup.port import DrivePort
from drives.cia402.drive import Drive, DriveGroup
from drives.cia402.units import axis_scaling, position_si
from drives.errors import BringUpRefused, BusError, BusOff, DrivePowered, DriveSilent


def bring_up_core(
    core: Core, plans: Sequence[DrivePlan], port: DrivePort, cycle: CycleSettings
) -> Generator[Progress, None, bool]:
    """Bring up all drives; True on success, False if the core has a verdict instead.

    Raises:
        BringUpRefused: a drive is not the one in the configuration files, or refuses their values.
            Another attempt would fail in the same way.
    """
    core.mode = table.next_mode(core.mode, Event.BRING_UP_BEGUN)
    core.events.append("bring-up begun")
    try:
        # A reset request includes consent to switch off a drive that holds the leg.
        steps = bring_up(plans, port, cycle, may_switch_off=core.reset_cycles_left > 0)
        reports = yield from _told(core, steps)
    except BringUpRefused as refused:
        # The usual bring-up, without the limits of a homing or sign test, may still succeed.
        preparing = core.single_axis is not None
        fail(core, Cause.BRING_UP_FAILED, refused.drive, str(refused))
        if preparing:
            return False
        raise
    except DrivePowered as powered:
        _wait_for_reset(core, powered)
        return False
    except DriveSilent as silent:
        fail(core, Cause.DRIVE_SILENT, silent.drive, str(silent))
        return False
    except BusError as error:
        cause = Cause.BUS_OFF if isinstance(error, BusOff) else Cause.BUS_DOWN
        fail(core, cause, "", error.what)
        return False
    _take_over(core, plans, reports, port.now_ns())
    return True


def _wait_for_reset(core: Core, powered: DrivePowered) -> None:
    """Enter FAULT because a drive still holds the leg; it holds until a reset is requested."""
    cause = Cause.DRIVE_POWERED
    core.verdict = Verdict(
        core.config.categories.of(cause), cause, powered.drive, detail=powered.state
    )
    core.mode = table.next_mode(core.mode, Event.DRIVE_FAULTY)
    core.single_axis = None
    core.reset_cycles_left = 0
    noted = latching.verdict_of(core.notes.latched)
    if noted is not None and noted.cause != Cause.LAST_END_UNKNOWN:
        latching.take_over(core)
    core.events.append(str(powered))
    core.progress = ""


def fail(core: Core, cause: Cause, drive: str, detail: str) -> None:
    """Return to OFF with a verdict; an event is published only if the verdict is a new one."""
    if core.mode == Mode.BRINGING_UP:
        core.mode = table.next_mode(core.mode, Event.DRIVES_LOST)
    verdict = Verdict(core.config.categories.of(cause), cause, drive, detail=detail)
    if verdict != core.verdict:
        core.events.append(f"bring-up failed: {detail}")
    core.verdict = verdict
    core.single_axis = None
    core.reset_cycles_left = 0
    core.progress = ""
    for axis in core.axes:
        # The state of the other drives is unknown too: each may have lost power and its home.
        axis.homed = False


def _told(
    core: Core, steps: Generator[Progress, None, tuple[DriveReport, ...]]
) -> Generator[Progress, None, tuple[DriveReport, ...]]:
    """Pass the bring-up steps on and write each one into the core's progress line."""
    while True:
        try:
            progress = next(steps)
        except StopIteration as stop:
            return stop.value
        core.progress = (
            f"{progress.done_count}/{progress.total_count} {progress.drive} {progress.text}"
        )
        yield progress


def _take_over(
    core: Core, plans: Sequence[DrivePlan], reports: Sequence[DriveReport], now_ns: int
) -> None:
    """Put the drives under control of the core and reset all state of an earlier bring-up."""
    core.drives = DriveGroup([Drive(plan.description, now_ns) for plan in plans])
    for axis, plan, report in zip(core.axes, plans, reports, strict=True):
        _begin(core, axis, plan, report)
    exercises.reset(core)
    for leg in core.legs:
        leg.estimate = None
        leg.observer_started, leg.observer_bad_cycles = False, 0
    core.verdict = Verdict()
    core.load_checked = False
    latched = latching.take_over(core)
    event = Event.STILL_LATCHED if latched else Event.BRING_UP_DONE
    core.mode = table.next_mode(core.mode, event)
    core.progress = ""
    unreferenced = [axis for axis in core.axes if not axis.referenced]
    names = ", ".join(f"{axis.name} ({axis.unreferenced_why})" for axis in unreferenced)
    for report in reports:
        core.events += _errors_found(report)
    core.events.append("drives are up" + (f", not referenced: {names}" if names else ""))


def _errors_found(report: DriveReport) -> Iterator[str]:
    """Event texts for errors found at bring-up; they are not reset and cause no stop later."""
    if report.error_code:
        yield f"{report.name}: found with error {report.error_code:04X}h: {report.error_text}"
    for code, one in {one.code: one for one in report.emergencies}.items():
        does = one.reaction.value
        yield f"{report.name}: EMCY {code:04X}h during bring-up: {one.text}; the drive: {does}"


def _begin(core: Core, axis: Axis, plan: DrivePlan, report: DriveReport) -> None:
    axis.scaling = axis_scaling(plan.description, report.base)
    if axis.serial_number != report.serial_number:
        core.evidence.pop(axis.name, None)  # it belongs to another drive
    axis.serial_number = report.serial_number
    axis.sign_proven = proven(core.notes, axis.name, axis.wiring, report.serial_number)
    axis.homed = axis.homed and not report.reference_lost
    axis.unreferenced_why = _why_unreferenced(core, axis, plan, report)
    axis.referenced = not axis.unreferenced_why
    axis.joint = Joint()
    axis.feedback = None
    axis.stop = None
    axis.effort_sent_si = 0.0
    axis.reached_enabled, axis.unready_cycles, axis.unasked_cycles = False, 0, 0
    axis.seen_off = True  # bring-up goes on with no drive that has power
    axis.emergencies_seen = 0
    code = report.error_code
    axis.error_found = f"{code:04X}h {report.error_text}" if code else ""


def _why_unreferenced(core: Core, axis: Axis, plan: DrivePlan, report: DriveReport) -> str:
    """The reason why an axis is not referenced; empty if it is.

    An axis is referenced if it is homed, or if its absolute encoder agrees with the noted pose.
    """
    if report.reference_lost:
        return "its encoder is in error"
    says_so = plan.description.profile.referenced_bit is not None
    if axis.homed and (report.homed or not says_so):
        return ""
    if not report.absolute:
        return "" if report.homed else "home it"
    here_si = position_si(report.position_counts, axis.scaling)
    return disagreement(core.notes, axis.name, here_si, axis.poses)
