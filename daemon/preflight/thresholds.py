"""Thresholds that `gaitd check` warns of because their check can no longer act.

For each monitored quantity this file computes the most that it can be before another limit stops
the leg, or before the leg is where the check is too late. A threshold at or above it is never
reached first. Each warning names the quantity that it was computed from.

The bounds, for each axis:

    quantity                         the most that it can be
    -------------------------------  -----------------------------------------------------------
    load at rest, wrong              twice the load, shown with the wrong sign, and breakaway
                                     there
    load in the self-test, wrong     the same without friction, which cancels there
    gap of sent and measured effort  the effort limit
    mean deviation of a stride       what guidance gives up to the tracking limit
    rise or swing of the patient     the same
    effort against the motion        what the hold gives up to its distance limit
    distance to the reference        the range of the axis
    power                            effort limit times speed limit
    energy of a stride               effort limit over the range, there and back
    power of the assist              its effort limit times the speed limit
    change of an effort in a cycle   from one limit to the other
    temperature                      the largest that its object can hold
    cycles until a sensor is judged  those in which the axis crosses its range at its speed limit
    cycles until a stop is judged    those that the ramp takes from the highest speed of the gait
"""

import math
from collections.abc import Iterator
from operator import attrgetter
from pathlib import Path
from typing import Final, NamedTuple

from gaitd_toml import ConfigError, Errors

from daemon.config.bundle import Settings
from daemon.config.robot import friction_over_position, friction_parameters, leg_parameters
from daemon.config.settings import Impedance
from daemon.core.motion.gait_shape import load_at
from daemon.core.safety.checks import EFFORT_MARGIN_RATIO
from daemon.core.safety.limits import AxisLimits, axis_limits
from daemon.preflight import workspace
from observer.mechanism.friction import at_position

PHASES: Final = 60
"""Number of poses over the stride."""
_MS: Final = 1e-3


class _Keys(NamedTuple):
    """Keys of an axis in limits.toml, and its units."""

    axis: str
    effort: str
    length: str
    effort_max: str
    effort_deviation: str
    static_load: str
    load_deviation: str
    sign_mismatch: str
    effort_rate: str
    assist_max: str
    assist_rate: str
    rise: str
    swing: str
    patient: str
    self_test: str


_KEYS: Final = (
    _Keys(
        *("hip", "N m", "deg", "torque_max_nm", "torque_deviation_max_nm"),
        *("static_load_tolerance_nm", "load_deviation_max_nm", "sign_mismatch_torque_min_nm"),
        *("torque_rate_max_nm_per_s", "assist_max_nm", "assist_rate_max_nm_per_s"),
        *("hip.rise_nm", "hip.swing_nm", "hip.patient_nm", "hip.load_tolerance_nm"),
    ),
    _Keys(
        *("slide", "N", "m", "force_max_n", "force_deviation_max_n"),
        *("static_load_tolerance_n", "load_deviation_max_n", "sign_mismatch_force_min_n"),
        *("force_rate_max_n_per_s", "assist_max_n", "assist_rate_max_n_per_s"),
        *("slide.rise_n", "slide.swing_n", "slide.patient_n", "slide.load_tolerance_n"),
    ),
)

Row = tuple[Path, str, float, float, str]
"""File, key, value, the most that is compared with it, and where that comes from."""


class _Rest(NamedTuple):
    """An axis at rest in one pose."""

    load_si: float
    """Its size."""
    breakaway_si: float
    """Friction there."""


class _Axis(NamedTuple):
    """What the bounds of one axis are computed from; rad and N m, or m and N."""

    keys: _Keys
    limits: AxisLimits
    rests: tuple[_Rest, ...]
    """Over the poses of the gait."""
    gait_speed_si: float
    range_si: float
    effort_si: float
    """The effort above which EFFORT_LIMIT stops the leg."""
    held_si: float
    """The effort of the hold where its distance limit stops the leg, or the effort limit."""
    guided_si: float
    """The effort of guidance where the tracking limit stops the leg, or the effort limit."""


def idle_thresholds(settings: Settings) -> Errors:
    """Thresholds whose check can no longer act, with the reason."""
    for file, key, value, most, why in _rows(settings):
        if value >= most:
            yield ConfigError(file, key, value, f"its check can no longer act: {why}")


def _rows(settings: Settings) -> Iterator[Row]:
    period_s, axes = settings.trainer.cycle.period_ms * _MS, _axes(settings)
    for number, axis in enumerate(axes):
        yield from _efforts(settings, axis)
        yield from _distances(settings, axis)
        yield from _powers(settings, axis, period_s)
        yield from _temperature(settings, axis, number)
        if settings.robot.patient is not None:
            yield from _patient(settings, axis)
    yield from _durations(settings, axes, period_s)


def _axes(settings: Settings) -> tuple[_Axis, ...]:
    leg, gait = leg_parameters(settings.robot), settings.trainer.gait
    motions = workspace.gait_motions(leg, gait, gait.cadence_max_hz, PHASES)
    loads = [load_at(leg, motion.position) for motion in motions]
    frictions = friction_parameters(settings.robot)
    hold, guidance = _stiffness(settings.trainer.hold), _stiffness(gait.impedance)
    limits = axis_limits(settings.limits, settings.robot)
    return tuple(
        _Axis(
            keys=keys,
            limits=own,
            rests=tuple(
                _Rest(
                    abs(load[number]),
                    at_position(friction, over, motion.position[number]).stribeck,
                )
                for load, motion in zip(loads, motions, strict=True)
            ),
            gait_speed_si=max(abs(motion.velocity[number]) for motion in motions),
            range_si=own.position_max_si - own.position_min_si,
            effort_si=EFFORT_MARGIN_RATIO * own.effort_max_si,
            held_si=min(hold[number] * own.hold_distance_max_si, own.effort_max_si),
            guided_si=min(guidance[number] * own.tracking_max_si, own.effort_max_si),
        )
        for number, (keys, own, friction, over) in enumerate(
            zip(_KEYS, limits, frictions, friction_over_position(settings.robot), strict=True)
        )
    )


def _stiffness(impedance: Impedance) -> tuple[float, float]:
    return impedance.hip.stiffness_nm_per_rad, impedance.slide.stiffness_n_per_m


def _efforts(settings: Settings, axis: _Axis) -> Iterator[Row]:
    keys, limits, file = axis.keys, axis.limits, settings.file.limits
    name, unit = keys.axis, keys.effort
    load_si = max(rest.load_si for rest in axis.rests)
    static_si = max(2.0 * rest.load_si + rest.breakaway_si for rest in axis.rests)
    tested_si = 2.0 * load_si
    loaded = f"over the gait the {name} carries up to {load_si:.4g} {unit}"
    nothing_hangs_on_it = all(rest.load_si <= rest.breakaway_si for rest in axis.rests)
    if nothing_hangs_on_it:  # only its sensor can be wrong
        static_si = tested_si = limits.effort_max_si
        loaded = f"{name}.{keys.effort_max} is {limits.effort_max_si:g}"
    wrong = f"{loaded}, and a drive that shows it with the wrong sign"
    yield (
        file,
        f"{name}.{keys.static_load}",
        limits.static_load_tolerance_si,
        static_si,
        f"{wrong} differs by at most {static_si:.4g} {unit}, with breakaway friction",
    )
    tolerance = attrgetter(keys.self_test)(settings.trainer.self_test)
    yield (
        settings.file.path,
        f"self_test.{keys.self_test}",
        tolerance,
        tested_si,
        f"{wrong} differs by at most {tested_si:.4g} {unit}",
    )
    yield (
        file,
        f"{name}.{keys.effort_deviation}",
        limits.effort_deviation_max_si,
        limits.effort_max_si,
        f"a drive that gives nothing of {limits.effort_max_si:g} {unit} differs by no more",
    )
    yield (
        file,
        f"{name}.{keys.load_deviation}",
        limits.load_deviation_max_si,
        axis.guided_si,
        _guided(axis),
    )
    yield (
        file,
        f"{name}.{keys.sign_mismatch}",
        limits.sign_mismatch_effort_min_si,
        axis.held_si,
        f"in mode hold a drive pushes with at most {axis.held_si:.4g} {unit}, and then "
        f"hold_distance_max or {keys.effort_max} is reached",
    )


def _distances(settings: Settings, axis: _Axis) -> Iterator[Row]:
    limits, unit = axis.limits, axis.keys.length
    scale = 180.0 / math.pi if unit == "deg" else 1.0
    table = getattr(settings.limits, axis.keys.axis)
    for name in ("tracking_max", "hold_distance_max", "following_error"):
        key = f"{name}_{unit}"
        most = scale * (limits.position_max_si - limits.position_min_si)
        why = f"the range of the {axis.keys.axis} is {most:.4g} {unit}"
        yield settings.file.limits, f"{axis.keys.axis}.{key}", getattr(table, key), most, why


def _powers(settings: Settings, axis: _Axis, period_s: float) -> Iterator[Row]:
    keys, limits, file = axis.keys, axis.limits, settings.file.limits
    name, speed_si = keys.axis, axis.limits.velocity_max_si
    power_w = axis.effort_si * speed_si
    why = f"the limits of effort and speed stop the {name} at {power_w:.4g} W together"
    yield file, f"{name}.power_max_w", limits.power_max_w, power_w, why
    energy_j = 2.0 * axis.effort_si * axis.range_si
    why = f"a stride through the whole range at the limit of effort takes {energy_j:.4g} J"
    yield file, f"{name}.stride_energy_max_j", limits.stride_energy_max_j, energy_j, why
    assist_w = limits.assist_max_si * speed_si
    why = f"{keys.assist_max} at the limit of speed is {assist_w:.4g} W"
    yield file, f"{name}.assist_power_max_w", limits.assist_power_max_w, assist_w, why
    for key, rate, most_si in (
        (keys.effort_rate, limits.effort_rate_max_si_per_s, limits.effort_max_si),
        (keys.assist_rate, limits.assist_rate_max_si_per_s, limits.assist_max_si),
    ):
        rate_max = 2.0 * most_si / period_s
        why = f"in one cycle it allows {rate * period_s:.4g} {keys.effort}, from limit to limit"
        yield file, f"{name}.{key}", rate, rate_max, why


def _temperature(settings: Settings, axis: _Axis, number: int) -> Iterator[Row]:
    for leg in settings.legs:
        drive = (leg.hip, leg.slide)[number]
        source = drive.profile.temperature
        if source is not None:
            most = source.values[-1] * source.degc_per_count
            why = f"{source.place} of {drive.name} holds at most {most:.4g} degC"
            key = f"{axis.keys.axis}.temperature_max_degc"
            yield settings.file.limits, key, axis.limits.temperature_max_degc, most, why


def _durations(settings: Settings, axes: tuple[_Axis, ...], period_s: float) -> Iterator[Row]:
    """Counts of cycles, each by the axis that is quicker."""
    file, communication = settings.file.limits, settings.limits.communication
    crossing, name = min(
        (axis.range_si / axis.limits.velocity_max_si / period_s, axis.keys.axis) for axis in axes
    )
    why = f"at its limit of speed the {name} crosses its whole range in {crossing:.0f} cycles"
    watch = settings.limits.watch
    for key, cycles in (
        ("communication.encoder_frozen_cycles", communication.encoder_frozen_cycles),
        ("communication.sample_age_max_cycles", communication.sample_age_max_cycles),
        ("communication.overruns_in_a_row", communication.overruns_in_a_row),
        ("watch.deviation_cycles", watch.deviation_cycles),
        ("watch.sign_mismatch_cycles", watch.sign_mismatch_cycles),
    ):
        yield file, key, cycles, crossing, why
    ratio = communication.encoder_jump_ratio
    why = f"in one cycle it allows the {name} a step as long as its whole range"
    yield file, "communication.encoder_jump_ratio", ratio, crossing, why
    ramp, name = min(
        (
            axis.gait_speed_si / axis.limits.quick_stop_deceleration_si_per_s2 / period_s,
            axis.keys.axis,
        )
        for axis in axes
    )
    why = (
        f"a quick stop of the {name} from the highest speed of the gait is over in {ramp:.0f} "
        "cycles, and its ramp is compared only after these"
    )
    yield file, "stop.obey_cycles", settings.limits.stop.obey_cycles, ramp, why


def _patient(settings: Settings, axis: _Axis) -> Iterator[Row]:
    keys, file = axis.keys, settings.file.limits
    yield file, f"spasm.{keys.rise}", axis.limits.spasm_rise_si, axis.guided_si, _guided(axis)
    yield file, f"clonus.{keys.swing}", axis.limits.clonus_swing_si, axis.guided_si, _guided(axis)
    pushes = attrgetter(keys.patient)(settings.limits.stop)
    if pushes == 0.0:
        why = "no quick stop is compared with a patient who pushes"
        yield file, f"stop.{keys.patient}", pushes, 0.0, why


def _guided(axis: _Axis) -> str:
    """Where guidance ends, in words."""
    keys, effort_si = axis.keys, f"{axis.guided_si:.4g} {axis.keys.effort}"
    if axis.guided_si == axis.limits.effort_max_si:
        return f"{keys.axis}.{keys.effort_max} allows guidance no more than {effort_si}"
    return f"at {effort_si} of guidance the {keys.axis} has reached tracking_max"
