"""Bring-up of the drives from mode OFF to READY, with progress reported step by step."""

from collections.abc import Generator, Sequence
from contextlib import closing

from gaitd_names import Cause, EventCode

from daemon.core.state import Core
from daemon.core.steps import (
    estimation,
    exercises,
    passive,
    persistence,
    sensing,
    single_axis,
    supervisor,
    targets,
)
from drives.bringup.bringup import DriveReport, Progress, bring_up
from drives.bringup.plan import CycleSettings, DrivePlan
from drives.bringup.port import DrivePort
from drives.cia402.drive import Drive, DriveGroup
from drives.errors import BringUpRefused, BusError, BusOff, DrivePowered, DriveSilent


def bring_up_core(
    core: Core, plans: Sequence[DrivePlan], port: DrivePort, cycle: CycleSettings
) -> Generator[Progress, None, bool]:
    """Bring up all drives; True on success, False if the core has a verdict instead.

    Raises:
        BringUpRefused: a drive is not the one in the configuration files, or refuses their values.
            Another attempt would fail in the same way.
    """
    supervisor.begin_bring_up(core)
    try:
        # A reset request includes consent to switch off a drive that holds the leg.
        steps = bring_up(plans, port, cycle, may_switch_off=core.reset_cycles_left > 0)
        reports = yield from _with_progress(core, steps)
    except BringUpRefused as refused:
        # The usual bring-up, without the limits of a homing or sign test, may still succeed.
        preparing = core.single_axis is not None
        supervisor.fail_bring_up(core, Cause.BRING_UP_FAILED, refused.drive, str(refused))
        if preparing:
            return False
        raise
    except DrivePowered as powered:
        supervisor.wait_for_reset(core, powered.drive, powered.state)
        return False
    except DriveSilent as silent:
        supervisor.fail_bring_up(core, Cause.DRIVE_SILENT, silent.drive, str(silent))
        return False
    except BusError as error:
        cause = Cause.BUS_OFF if isinstance(error, BusOff) else Cause.BUS_DOWN
        supervisor.fail_bring_up(core, cause, "", error.what)
        return False
    _take_over(core, plans, reports, port.now_ns())
    return True


def _with_progress(
    core: Core, steps: Generator[Progress, None, tuple[DriveReport, ...]]
) -> Generator[Progress, None, tuple[DriveReport, ...]]:
    """Pass the bring-up steps on and show each one in the core's records."""
    with closing(steps):
        while True:
            try:
                progress = next(steps)
            except StopIteration as stop:
                return stop.value
            supervisor.show_progress(
                core, progress.drive, progress.done_count, progress.total_count
            )
            yield progress


def _take_over(
    core: Core, plans: Sequence[DrivePlan], reports: Sequence[DriveReport], now_ns: int
) -> None:
    """Put the drives under control of the core and reset all state of an earlier bring-up."""
    single_axis.drop_tests_of_other_drives(core, reports)
    persistence.forget_other_drives(core, reports)
    numbers = {report.name: report.serial_number for report in reports}
    for leg in core.legs:
        leg.passive = passive.with_drives(leg, [numbers[axis.name] for axis in leg.axes])
    sensing.begin(core, plans, reports)
    persistence.check_signs(core)
    targets.reset(core)
    exercises.reset(core)
    for leg in core.legs:
        leg.estimated = estimation.cleared(leg.estimated)
    supervisor.take_drives(core, DriveGroup([Drive(plan.description, now_ns) for plan in plans]))
    for report in reports:
        _report_errors(core, report)
    core.report(EventCode.DRIVES_UP)
    for axis in core.axes:
        if not axis.sensed.referenced:
            core.report(EventCode.NOT_REFERENCED, axis.name, axis.sensed.doubt)


def _report_errors(core: Core, report: DriveReport) -> None:
    """Publish errors found at bring-up; they are not reset and cause no stop later."""
    name, code = report.name, report.error_code
    if code:
        core.report(EventCode.FOUND_WITH_ERROR, name, code, said=report.error_text)
    for one in {one.code: one for one in report.emergencies}.values():
        core.report(EventCode.EMCY_IN_BRING_UP, name, one.code, said=one.text)
