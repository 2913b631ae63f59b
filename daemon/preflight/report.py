"""The report of `gaitd check`: the meaning of a configuration's numbers at the joint.

`examine` computes it, without a bus; `refusals` finds where a drive's EDS lacks what bring-up needs
(`axes.py`), or where a swept stop of the gait leaves the workspace.
"""

import math
from typing import Final

import msgspec
from gaitd_names import Cause, StopCategory
from gaitd_toml import ConfigError, Errors

from daemon.config.bundle import Settings
from daemon.config.drive_plan import cycle_settings
from daemon.config.robot import friction_range, leg_parameters
from daemon.config.trainer import drive_names, is_file, real_drives
from daemon.preflight import workspace
from daemon.preflight.axes import AxisMeaning, axis_errors, axis_meanings
from daemon.preflight.braking import BrakingMeaning, braking_errors, braking_meanings
from daemon.preflight.doubts import doubts
from daemon.preflight.homing import homing_errors
from daemon.preflight.motion import decelerations, limit_box
from daemon.preflight.runaway_report import RunawayMeaning, runaway_errors, runaway_meanings
from daemon.preflight.stability import LoopMeaning, loop_errors, loop_meanings, loop_warnings
from daemon.preflight.workspace import Drift, Extent, StopKind, Sweep
from daemon.wire.causes import FIXED_CATEGORY
from daemon.zenoh_io import endpoints
from drives.bringup.bus_load import bus_load

DRIFT_POSES: Final = 24


class Report(msgspec.Struct, frozen=True):
    """The contents of the report of `gaitd check`, for text and JSON."""

    file: str
    legs: tuple[str, ...]
    patient: str
    axes: tuple[AxisMeaning, ...]
    stops: tuple["StopMeaning", ...]
    braking: tuple[BrakingMeaning, ...]
    sweeps: tuple["SweepMeaning", ...]
    drift: "DriftMeaning"
    runaways: tuple[RunawayMeaning, ...]
    loops: tuple[LoopMeaning, ...]
    bus: "BusMeaning"
    shutdown: tuple[str, ...]
    warnings: tuple[str, ...]
    sha256: dict[str, str]


class StopMeaning(msgspec.Struct, frozen=True):
    """How the machine stops for one cause."""

    cause: str
    category: str
    fixed: bool
    """Fixed by the design; no file can choose it."""


class SweepMeaning(msgspec.Struct, frozen=True):
    """Extent of the leg's motion in one kind of stop, over a stride at the highest cadence."""

    kind: str
    hip_deg: tuple[float, float]
    slide_m: tuple[float, float]
    least_singularity_ratio: float
    hip_end_speed_rad_per_s: float
    """At a position limit; 0 where none is reached."""
    slide_end_speed_m_per_s: float
    stays_inside: bool


class DriftMeaning(msgspec.Struct, frozen=True):
    """Motion of the leg with both drives off, from rest: the worst over the gait's poses."""

    hip_moved_deg: float
    hip_speed_rad_per_s: float
    hip_from_deg: float
    hip_to_deg: float
    slide_moved_m: float
    slide_speed_m_per_s: float
    slide_from_m: float
    slide_to_m: float
    reaches_limit: bool


class BusMeaning(msgspec.Struct, frozen=True):
    """Load of the CAN bus in the worst case."""

    interface: str
    channel: str
    bitrate_bit_per_s: int
    load_ratio: float
    load_max_ratio: float
    burst_ms: float
    window_ms: float
    real_drives: tuple[str, ...]
    virtual_drives: tuple[str, ...]
    """Those that `gaitd sim` plays on this bus."""


def examine(settings: Settings) -> Report:
    """Compute the whole report."""
    robot = settings.robot
    drift = _drift(settings)
    axes, loops = axis_meanings(settings), loop_meanings(settings)
    patient = robot.patient
    return Report(
        file=str(settings.file.path),
        legs=tuple(leg.name for leg in settings.legs),
        patient=f"{patient.mass_kg:g} kg, {patient.height_m:g} m" if patient else "none",
        axes=axes,
        stops=tuple(_stops(settings)),
        braking=braking_meanings(settings),
        sweeps=_sweeps(settings),
        drift=drift,
        runaways=runaway_meanings(settings),
        loops=loops,
        bus=_bus(settings),
        shutdown=_shutdown(settings, drift),
        warnings=(
            *_warnings(settings, axes, drift),
            *loop_warnings(loops),
            *doubts(settings),
        ),
        sha256=dict(settings.hashes),
    )


def refusals(settings: Settings, report: Report) -> Errors:
    """Unsupported objects, ramps without torque, and stops that leave the workspace."""
    yield from axis_errors(settings, report.axes)
    steep = list(braking_errors(settings, report.braking))
    yield from steep
    if not steep:  # the sweeps rely on the ramps
        yield from _sweep_errors(settings, report.sweeps)
        yield from runaway_errors(settings, report.runaways)
    yield from homing_errors(settings)
    yield from loop_errors(report.loops)


def _sweep_errors(settings: Settings, sweeps: tuple[SweepMeaning, ...]) -> Errors:
    stop_ratio = settings.limits.singularity.stop_ratio
    for sweep in sweeps:
        if not sweep.stays_inside:
            allowed = (
                "gait, springs and quick-stop ramps that stay inside the limits and above "
                f"|sin| = {stop_ratio:g} of shank and shoe; with {sweep.kind} the leg goes to "
                f"hip {sweep.hip_deg[0]:.1f} to {sweep.hip_deg[1]:.1f} deg, "
                f"slide {sweep.slide_m[0]:.3f} to {sweep.slide_m[1]:.3f} m, "
                f"|sin| {sweep.least_singularity_ratio:.2f}"
            )
            cadence_hz = settings.trainer.gait.cadence_max_hz
            yield ConfigError(settings.file.path, "gait.cadence_max_hz", cadence_hz, allowed)


def _stops(settings: Settings) -> list[StopMeaning]:
    chosen = {
        Cause(name): StopCategory(text) for name, text in settings.limits.stop_category.items()
    }
    rows = {cause: (category, True) for cause, category in FIXED_CATEGORY.items()}
    rows |= {cause: (category, False) for cause, category in chosen.items()}
    return [
        StopMeaning(cause, category, fixed)
        for cause, (category, fixed) in sorted(rows.items(), key=_harshest_first)
    ]


_CAUSES: Final = tuple(Cause)


def _harshest_first(row: tuple[Cause, tuple[StopCategory, bool]]) -> tuple[int, int]:
    cause, (category, _) = row
    return -category.severity, _CAUSES.index(cause)


def _sweeps(settings: Settings) -> tuple[SweepMeaning, ...]:
    leg, (frictions, _) = (
        leg_parameters(settings.robot),
        friction_range(settings.robot, settings.limits),
    )
    gait, box, ramps = (
        settings.trainer.gait,
        limit_box(settings.limits),
        decelerations(settings.limits),
    )
    motions = workspace.gait_motions(leg, gait, gait.cadence_max_hz)
    sweeps = (
        workspace.sweep_ramps(leg, motions, ramps),
        workspace.sweep_coasting(leg, frictions, motions, ramps, box, 0),
        workspace.sweep_coasting(leg, frictions, motions, ramps, box, 1),
    )
    return tuple(_sweep(settings, sweep) for sweep in sweeps)


def _sweep(settings: Settings, sweep: Sweep) -> SweepMeaning:
    extent: Extent = sweep.extent
    inside = extent.least_singularity_ratio >= settings.limits.singularity.stop_ratio
    if sweep.kind is StopKind.BOTH_RAMP:
        inside = inside and extent.inside(limit_box(settings.limits))
    return SweepMeaning(
        kind=sweep.kind.value,
        hip_deg=(math.degrees(extent.low[0]), math.degrees(extent.high[0])),
        slide_m=(extent.low[1], extent.high[1]),
        least_singularity_ratio=extent.least_singularity_ratio,
        hip_end_speed_rad_per_s=sweep.end_speed[0],
        slide_end_speed_m_per_s=sweep.end_speed[1],
        stays_inside=inside,
    )


def _drift(settings: Settings) -> DriftMeaning:
    leg, (frictions, _) = (
        leg_parameters(settings.robot),
        friction_range(settings.robot, settings.limits),
    )
    gait, box = settings.trainer.gait, limit_box(settings.limits)
    poses = workspace.gait_motions(leg, gait, gait.cadence_max_hz, DRIFT_POSES)
    drifts = [workspace.drift(leg, frictions, motion.position, box) for motion in poses]
    hip, slide = max(drifts, key=_hip_moved), max(drifts, key=_slide_moved)
    return DriftMeaning(
        hip_moved_deg=math.degrees(_hip_moved(hip)),
        hip_speed_rad_per_s=max(drift.speed_max[0] for drift in drifts),
        hip_from_deg=math.degrees(hip.start[0]),
        hip_to_deg=math.degrees(hip.end[0]),
        slide_moved_m=_slide_moved(slide),
        slide_speed_m_per_s=max(drift.speed_max[1] for drift in drifts),
        slide_from_m=slide.start[1],
        slide_to_m=slide.end[1],
        reaches_limit=any(drift.reached_limit for drift in drifts),
    )


def _hip_moved(drift: Drift) -> float:
    return abs(drift.end[0] - drift.start[0])


def _slide_moved(drift: Drift) -> float:
    return abs(drift.end[1] - drift.start[1])


def _bus(settings: Settings) -> BusMeaning:
    trainer = settings.trainer
    real = real_drives(trainer)
    load = bus_load(
        settings.drives,
        cycle_settings(trainer.cycle),
        trainer.cycle.master_heartbeat_ms,
        trainer.bus.bitrate_bit_per_s,
    )
    return BusMeaning(
        interface=trainer.bus.interface,
        channel=trainer.bus.channel,
        bitrate_bit_per_s=trainer.bus.bitrate_bit_per_s,
        load_ratio=load.busy_ratio,
        load_max_ratio=trainer.bus.load_max_ratio,
        burst_ms=load.burst_s * 1e3,
        window_ms=trainer.cycle.window_ms,
        real_drives=real,
        virtual_drives=tuple(name for name in drive_names(trainer) if name not in real),
    )


def _shutdown(settings: Settings, drift: DriftMeaning) -> tuple[str, ...]:
    limits = settings.limits
    hip_s = limits.hip.velocity_max_rad_per_s / limits.hip.quick_stop_deceleration_rad_per_s2
    slide_s = limits.slide.velocity_max_m_per_s / limits.slide.quick_stop_deceleration_m_per_s2
    brakes = [name for name, table in (("hip", limits.hip), ("slide", limits.slide)) if table.brake]
    held = f"{' and '.join(brakes)} on the brake" if brakes else "no axis has a brake"
    return (
        f"both axes ramp down together, at rest after at most {max(hip_s, slide_s):.2f} s (S1)",
        f"then the drives are without power; {held}",
        f"a leg left where it stands then moves up to {drift.hip_moved_deg:.1f} deg at up to "
        f"{drift.hip_speed_rad_per_s:.2f} rad/s, the slide {drift.slide_moved_m * 1e3:.0f} mm "
        f"at up to {drift.slide_speed_m_per_s:.2f} m/s",
        f"shutdown.effect: {settings.trainer.shutdown.effect}",
    )


def _warnings(settings: Settings, axes: tuple[AxisMeaning, ...], drift: DriftMeaning) -> list[str]:
    trainer = settings.trainer
    warnings = [f"{axis.name}: {warning}" for axis in axes for warning in axis.warnings]
    warnings += [
        f"zenoh.listen: {locator} can be reached from other machines"
        for locator in trainer.zenoh.listen
        if not endpoints.is_local(locator)
    ]
    if drift.reaches_limit:
        warnings.append("without power the leg moves to a position limit: check the springs")
    if settings.robot.patient is None:
        warnings.append("no patient is configured: for the empty machine alone")
    if settings.file.sim is not None and not is_file(settings.file.sim):
        warnings.append(f"sim: {settings.file.sim} does not exist, there is nothing to simulate")
    return warnings
