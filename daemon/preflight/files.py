"""Checks of the files of one configuration against each other.

Each check is one function that yields a `ConfigError` for each file and key that the operator
should change. All checks run, so that one run finds all errors. One is left out where its result
would only follow from another error: where it needs a table that was refused (`UNREAD`), or where a
check that it relies on (`_RELIES_ON`) has not passed. Rules that need the mechanism in motion
are in `motion.py`, rules about the drives in `drives.py`, those of real drives in `real_bus.py`,
those of the robot file alone in `robot.py`.
"""

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final, NamedTuple

from gaitd_names import Cause
from gaitd_toml import MISSING, ConfigError, Errors

from daemon.config.bundle import LegDrives, Settings
from daemon.config.drive_plan import cycle_settings, drive_limits, effort_per_motor_nm
from daemon.config.limit_settings import HipLimits, SlideLimits
from daemon.config.robot import friction_range
from daemon.config.unread import UNREAD, UnreadError
from daemon.preflight.assist import (
    ASSIST_CHECKS,
    a_fade_is_not_too_fast,
    assist_is_part_of_the_effort,
)
from daemon.preflight.drives import DRIVE_CHECKS
from daemon.preflight.motion import (
    MOTION_CHECKS,
    every_limit_can_be_reached,
    scenarios_have_the_effort,
    scenarios_stay_inside,
    the_gait_fits,
)
from daemon.preflight.real_bus import REAL_BUS_CHECKS
from daemon.preflight.robot import friction_laws_are_laws, the_integrator_is_stable
from daemon.wire.causes import CHOSEN_CATEGORY, DOUBTFUL_FEEDBACK, FIXED_CATEGORY, LOST_DRIVE
from drives.bringup.bus_load import bus_load
from drives.cia402.profile import DriveDescription
from drives.cia402.units import axis_scaling, expected_base
from observer.filter.status import START_RATIO_MIN

MASTER_HEARTBEATS_MISSED: Final = 3
"""A drive must not stop before this many of the master's heartbeats have failed to arrive."""
DRIVE_HEARTBEATS_MISSED: Final = 2
STANDSTILL_COUNTS: Final = 2
"""The standstill speed must exceed this many counts per cycle, or encoder noise is motion."""
GEAR_SHARE_MAX: Final = 3.0
"""A limit this many times above what the drive can give is the fault of the drive's gear, and a
smaller excess that of the limit."""
MOTOR_RPM_MAX: Final = 30_000
BURST_MAX_RATIO: Final = 0.5
"""SYNC, TPDOs and RPDOs of one cycle must fit into this part of it, so that late frames still
fit."""
SOCKETCAN_NAME: Final = r"[^/\s]{1,15}"
INTERFACE_NAME: Final = r"[a-z0-9_-]+"

_AT_LEAST_S1: Final = {
    Cause.DRIVE_FAULT: "the drive in fault cannot hold",
    Cause.EMERGENCY: "the drive that sent it may not hold",
    Cause.DRIVE_LEFT_ENABLED: "that drive does not hold any more",
    Cause.MODE_NOT_SHOWN: "that drive does not do what the core asks",
    Cause.NOT_FOLLOWING: "that drive does not do what the core asks",
    Cause.CYCLE_OVERRUN: "holding by the core needs a core that is in time",
    Cause.TRANSMIT_QUEUE_FULL: "holding by the core needs frames that leave",
    Cause.POSITION_LIMIT: "the joint is where the core's own command should never have led it",
    Cause.VELOCITY_LIMIT: "the core's own command did not keep the speed",
    Cause.EFFORT_LIMIT: "the drive gives more than the core commands",
    Cause.SINGULARITY: "near the stretched leg a small force of the core is a large torque",
}
"""Causes for which S2 is not allowed, because in S2 the core holds through the drives."""


class _Axis(NamedTuple):
    """Spelling of the keys of an axis."""

    name: str
    position_unit: str
    velocity_unit: str
    effort_key: str
    static_load_key: str
    kind: str


_AXES: Final = (
    _Axis(
        "hip",
        "deg",
        "rad_per_s",
        "torque_max_nm",
        "static_load_tolerance_nm",
        "rotary",
    ),
    _Axis("slide", "m", "m_per_s", "force_max_n", "static_load_tolerance_n", "linear"),
)


Check = Callable[[Settings], Errors]


class Found(NamedTuple):
    """Result of all checks."""

    errors: list[ConfigError]
    can_be_swept: bool
    """The sweeps of motion, which rely on the machine's numbers, have a meaning."""


def check_all(settings: Settings) -> Found:
    """Run all checks, in order; tables of the settings may be `UNREAD`."""
    errors: list[ConfigError] = []
    failed: set[Check] = set()
    for check in (*CHECKS, *ASSIST_CHECKS, *REAL_BUS_CHECKS, *DRIVE_CHECKS, *MOTION_CHECKS):
        if failed.intersection(_RELIES_ON.get(check, ())):
            failed.add(check)  # for those that rely on it in turn
            continue
        try:
            for error in check(settings):
                errors.append(error)
                failed.add(check)
        except UnreadError:
            failed.add(check)
    return Found(errors, not failed.intersection(_SWEEPS_RELY_ON))


def check_together(settings: Settings) -> None:
    """Refuse settings that do not fit together.

    Raises:
        ConfigError: with all errors.
    """
    errors = check_all(settings).errors
    if errors:
        raise ConfigError.combined(errors)


def _legs_have_names_of_their_own(settings: Settings) -> Errors:
    names = [leg.name for leg in settings.trainer.leg]
    for index, name in enumerate(names):
        if name in names[:index]:
            allowed = "another name than the other leg's"
            yield ConfigError(settings.file.path, f"leg[{index}].name", name, allowed)


def _axes_fit_their_joint(settings: Settings) -> Errors:
    for leg in settings.legs:
        for axis, drive, file in _drives_of(leg):
            kind = drive.axis.transmission.kind
            if kind != axis.kind:
                allowed = f'"{axis.kind}" for the {axis.name}'
                yield ConfigError(file, "transmission.kind", kind, allowed)


def _nodes_are_unique(settings: Settings) -> Errors:
    taken = {settings.trainer.cycle.master_node_id: "the master"}
    for leg in settings.legs:
        for _, drive, file in _drives_of(leg):
            if drive.node_id in taken:
                allowed = f"a unique node id; this one is that of {taken[drive.node_id]}"
                yield ConfigError(file, "node_id", drive.node_id, allowed)
            taken[drive.node_id] = drive.name


def _the_channel_is_of_its_interface(settings: Settings) -> Errors:
    bus, path = settings.trainer.bus, settings.file.path
    if not re.fullmatch(INTERFACE_NAME, bus.interface):
        allowed = "simulated, socketcan, or another interface of python-can by its own name"
        yield ConfigError(path, "bus.interface", bus.interface, allowed)
    if bus.interface == "socketcan" and not re.fullmatch(SOCKETCAN_NAME, bus.channel):
        allowed = "the name of a network interface, for example can0"
        yield ConfigError(path, "bus.channel", bus.channel, allowed)


def _heartbeats_fit_their_watches(settings: Settings) -> Errors:
    cycle, path = settings.trainer.cycle, settings.file.path
    beat_ms = cycle.master_heartbeat_ms
    if beat_ms % cycle.period_ms:
        allowed = f"a multiple of cycle.period_ms = {cycle.period_ms}"
        yield ConfigError(path, "cycle.master_heartbeat_ms", beat_ms, allowed)
    least_ms = MASTER_HEARTBEATS_MISSED * beat_ms
    if cycle.drive_detection_ms < least_ms:
        allowed = f">= {least_ms} and <= 100, {MASTER_HEARTBEATS_MISSED} heartbeats of the master"
        yield ConfigError(path, "cycle.drive_detection_ms", cycle.drive_detection_ms, allowed)
    if cycle.rpdo_timeout_ms < 2 * cycle.period_ms:
        allowed = f">= {2 * cycle.period_ms}, two cycles"
        yield ConfigError(path, "cycle.rpdo_timeout_ms", cycle.rpdo_timeout_ms, allowed)
    least_ms = DRIVE_HEARTBEATS_MISSED * cycle.drive_heartbeat_ms + cycle.period_ms
    timeout_ms = settings.limits.communication.heartbeat_timeout_ms
    if timeout_ms < least_ms:
        allowed = (
            f">= {least_ms}, {DRIVE_HEARTBEATS_MISSED} of cycle.drive_heartbeat_ms and a cycle"
        )
        yield ConfigError(
            settings.file.limits, "communication.heartbeat_timeout_ms", timeout_ms, allowed
        )


def _sync_is_one_that_the_drives_take(settings: Settings) -> Errors:
    file, cycle = settings.file.path, settings.trainer.cycle
    if cycle.sync_counter == 1:
        yield ConfigError(file, "cycle.sync_counter", 1, "0 for none, or 2 to 240")
    elif cycle.sync_counter:
        for drive in settings.drives:
            if not drive.profile.optional_objects.sync_counter:
                allowed = f"0: the profile of {drive.name} says it has no 1019h"
                yield ConfigError(file, "cycle.sync_counter", cycle.sync_counter, allowed)
                break
    window_ms = cycle.sync_window_ms
    if window_ms and not cycle.window_ms < window_ms <= cycle.period_ms:
        allowed = (
            f"0 for none, or above cycle.window_ms = {cycle.window_ms:g} up to {cycle.period_ms}: "
            "a drive drops our commands, too, when they come after it"
        )
        yield ConfigError(file, "cycle.sync_window_ms", window_ms, allowed)


def _the_bus_can_carry_it(settings: Settings) -> Errors:
    trainer = settings.trainer
    cycle = cycle_settings(trainer.cycle)
    rate, heartbeat_ms = trainer.bus.bitrate_bit_per_s, trainer.cycle.master_heartbeat_ms
    load = bus_load(settings.drives, cycle, heartbeat_ms, rate)
    window_s = min(BURST_MAX_RATIO * cycle.period_ms, trainer.cycle.window_ms) * 1e-3
    busy_ratio = load.busy_ratio
    for part, most, what in (
        (busy_ratio, trainer.bus.load_max_ratio, f"the bus is busy {busy_ratio:.0%} of the time"),
        (load.burst_s, window_s, f"the frames of a cycle take {load.burst_s * 1e3:.1f} ms"),
    ):
        if part > most:
            least = rate * part / most
            allowed = f"at least {least:.0f}: {what}"
            yield ConfigError(settings.file.path, "bus.bitrate_bit_per_s", rate, allowed)
            return


def _categories_are_complete_and_allowed(settings: Settings) -> Errors:
    file, table = settings.file.limits, settings.limits.stop_category
    chosen = {str(cause): cause for cause in CHOSEN_CATEGORY}
    for name, category in table.items():
        key = f"stop_category.{name}"
        if name not in chosen:
            yield ConfigError(file, key, category, _why_not_chosen(name, list(chosen)))
        elif category == "S2" and (why := _AT_LEAST_S1.get(chosen[name])):
            yield ConfigError(file, key, category, f"S1 or S0: {why}")
    for name in chosen:
        if name not in table:
            yield ConfigError(file, f"stop_category.{name}", MISSING, "one of S2, S1, S0")


def _why_not_chosen(name: str, known: list[str]) -> str:
    cause = Cause.__members__.get(name.upper())
    if cause is None:
        return f"unknown cause. Known: {', '.join(known)}"
    if cause not in FIXED_CATEGORY:
        return "not a key: this cause never stops a motion"
    reason = "the design does not make it configurable"
    if cause in DOUBTFUL_FEEDBACK:
        reason = "an axis never holds by an encoder that is not reliable"
    if cause in LOST_DRIVE:
        reason = "when one drive is lost the others ramp down at once"
    return f"not a key: fixed at {FIXED_CATEGORY[cause].name}, because {reason}"


def _ranges_are_ranges(settings: Settings) -> Errors:
    file = settings.file.limits
    for axis, table in _limit_tables(settings):
        low_key, high_key = (f"position_{end}_{axis.position_unit}" for end in ("min", "max"))
        margin_key = f"soft_margin_{axis.position_unit}"
        low, high = _number(table, low_key), _number(table, high_key)
        margin = _number(table, margin_key)
        if high <= low:
            allowed = f"> {axis.name}.{low_key} = {low:g}"
            yield ConfigError(file, f"{axis.name}.{high_key}", high, allowed)
        elif 2 * margin >= high - low:
            allowed = f"< {(high - low) / 2:g}, half of the range"
            yield ConfigError(file, f"{axis.name}.{margin_key}", margin, allowed)
    singularity = settings.limits.singularity
    if singularity.soft_ratio <= singularity.stop_ratio:
        allowed = f"> singularity.stop_ratio = {singularity.stop_ratio:g}"
        yield ConfigError(file, "singularity.soft_ratio", singularity.soft_ratio, allowed)
    clonus = settings.limits.clonus
    if clonus.patience_ms >= clonus.window_ms:
        allowed = f"< clonus.window_ms = {clonus.window_ms}"
        yield ConfigError(file, "clonus.patience_ms", clonus.patience_ms, allowed)


def _efforts_are_within_the_drives(settings: Settings) -> Errors:
    for axis, table in _limit_tables(settings):
        effort = _number(table, axis.effort_key)
        for drive in _drives_at(settings, axis):
            motor = drive.axis.motor
            motor_nm = motor.current_limit_a * motor.torque_constant_nm_per_a
            most = motor_nm * effort_per_motor_nm(drive)
            if effort > most:
                key = f"{axis.name}.{axis.effort_key}"
                allowed = f"<= {most:.1f}, what {drive.name} has at {motor.current_limit_a:g} A"
                yield ConfigError(settings.file.limits, key, effort, allowed)


def gears_fit_their_joint(settings: Settings) -> Errors:
    """Refuse a gear with which the motor is out of all proportion to the limits of its joint.

    A wrong gear scales position, speed and effort at once. So it is the gear that is named, and not
    each limit that then does not fit.
    """
    hip_limits, slide_limits = drive_limits(settings.limits)
    for leg in settings.legs:
        for axis, drive, file in _drives_of(leg):
            limits = hip_limits if axis is _AXES[0] else slide_limits
            transmission, motor = drive.axis.transmission, drive.axis.motor
            motor_nm = motor.current_limit_a * motor.torque_constant_nm_per_a
            most = motor_nm * effort_per_motor_nm(drive)
            speed_rpm = 60.0 * limits.velocity_max_si * transmission.revs_per_si
            unit = "N m" if transmission.kind == "rotary" else "N"
            lead = "" if transmission.lead_m is None else f" with lead_m = {transmission.lead_m:g}"
            if most * GEAR_SHARE_MAX < limits.effort_max_si:
                why = (
                    f"at {motor.current_limit_a:g} A {drive.name} gives {most:.3g} {unit}, and "
                    f"{axis.name}.{axis.effort_key} is {limits.effort_max_si:g}"
                )
            elif speed_rpm > MOTOR_RPM_MAX:
                speed = f"{axis.name}.velocity_max_{axis.velocity_unit}"
                why = (
                    f"at {speed} = {limits.velocity_max_si:g} the motor of {drive.name} would turn "
                    f"at {speed_rpm:.0f} rpm, and no servo motor reaches {MOTOR_RPM_MAX}"
                )
            else:
                continue
            allowed = f"the motor's revolutions per revolution of the joint's shaft{lead}: {why}"
            yield ConfigError(file, "transmission.gear_ratio", transmission.gear_ratio, allowed)


def _standstill_is_more_than_noise(settings: Settings) -> Errors:
    period_s = settings.trainer.cycle.period_ms * 1e-3
    for axis, _ in _limit_tables(settings):
        key = f"standstill_{axis.velocity_unit}"
        speed = _number(getattr(settings.limits.stop, axis.name), key)
        for drive in _drives_at(settings, axis):
            counts_per_si = abs(axis_scaling(drive, expected_base(drive)).counts_per_si)
            least = STANDSTILL_COUNTS / counts_per_si / period_s
            if speed < least:
                allowed = f">= {least:.2g}, {STANDSTILL_COUNTS} counts of {drive.name} per cycle"
                yield ConfigError(settings.file.limits, f"stop.{axis.name}.{key}", speed, allowed)


def _friction_laws_are_laws(settings: Settings) -> Errors:
    return friction_laws_are_laws(settings.file.robot, settings.robot)


def _static_loads_exceed_friction(settings: Settings) -> Errors:
    _, greatest = friction_range(settings.robot, settings.limits)
    for (axis, table), friction in zip(_limit_tables(settings), greatest, strict=True):
        tolerance = _number(table, axis.static_load_key)
        stribeck = friction.stribeck
        if tolerance <= stribeck:
            key = f"{axis.name}.{axis.static_load_key}"
            allowed = f"> {stribeck:g}, which friction alone can hide at rest"
            yield ConfigError(settings.file.limits, key, tolerance, allowed)


def _the_integrator_is_stable(settings: Settings) -> Errors:
    nearest_ratio = min(settings.limits.singularity.stop_ratio, START_RATIO_MIN)
    return the_integrator_is_stable(settings.file.robot, settings.robot, nearest_ratio)


CHECKS: Final = (
    _legs_have_names_of_their_own,
    _axes_fit_their_joint,
    gears_fit_their_joint,
    _nodes_are_unique,
    _the_channel_is_of_its_interface,
    _heartbeats_fit_their_watches,
    _sync_is_one_that_the_drives_take,
    _the_bus_can_carry_it,
    _categories_are_complete_and_allowed,
    _ranges_are_ranges,
    _efforts_are_within_the_drives,
    _standstill_is_more_than_noise,
    _friction_laws_are_laws,
    _static_loads_exceed_friction,
    _the_integrator_is_stable,
)


_SWEEPS_RELY_ON: Final = (
    _legs_have_names_of_their_own,
    _axes_fit_their_joint,
    _categories_are_complete_and_allowed,
    every_limit_can_be_reached,
    gears_fit_their_joint,
    _ranges_are_ranges,
    _friction_laws_are_laws,
    the_gait_fits,
)
_RELIES_ON: Final[dict[Check, tuple[Check, ...]]] = {
    **dict.fromkeys(REAL_BUS_CHECKS, (_the_channel_is_of_its_interface,)),
    gears_fit_their_joint: (_axes_fit_their_joint,),
    a_fade_is_not_too_fast: (assist_is_part_of_the_effort,),
    _efforts_are_within_the_drives: (_axes_fit_their_joint, gears_fit_their_joint),
    _standstill_is_more_than_noise: (_axes_fit_their_joint, gears_fit_their_joint),
    _the_integrator_is_stable: (_friction_laws_are_laws,),
    every_limit_can_be_reached: (_ranges_are_ranges,),
    the_gait_fits: (_ranges_are_ranges, every_limit_can_be_reached),
    scenarios_stay_inside: (_ranges_are_ranges, the_gait_fits),
    scenarios_have_the_effort: (the_gait_fits,),
}
"""Checks whose errors would only repeat, in other words, those of the checks named here."""


def _drives_of(leg: LegDrives) -> Iterator[tuple[_Axis, DriveDescription, Path]]:
    """The leg's drives whose files were not refused."""
    if leg.hip is not UNREAD:
        yield _AXES[0], leg.hip, leg.hip_file
    if leg.slide is not UNREAD:
        yield _AXES[1], leg.slide, leg.slide_file


def _drives_at(settings: Settings, axis: _Axis) -> Iterator[DriveDescription]:
    """The drives of one axis in all legs."""
    for leg in settings.legs:
        yield from (drive for at, drive, _ in _drives_of(leg) if at is axis)


def _limit_tables(settings: Settings) -> tuple[tuple[_Axis, HipLimits | SlideLimits], ...]:
    return (_AXES[0], settings.limits.hip), (_AXES[1], settings.limits.slide)


def _number(table: object, key: str) -> float:
    return float(getattr(table, key))
