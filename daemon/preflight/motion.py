"""Checks of gait, scenarios, self-test and limits against the mechanism in motion.

Checks as in `files.py`, in the order of MOTION_CHECKS. The sweeps with a coasting axis take longer
and are in `report.py`.
"""

import math
from itertools import pairwise
from typing import Final

import numpy as np
from gaitd_toml import ConfigError, Errors, PlainText

from daemon.config.bundle import Settings
from daemon.config.limit_settings import Limits
from daemon.config.robot import leg_parameters
from daemon.config.settings import Excite, Sinusoid
from daemon.core.exercises import self_test
from daemon.core.motion.gait_shape import gait_angles, gait_shape, joints_of_angles, load_at
from daemon.preflight.workspace import (
    Box,
    Extent,
    Motion,
    Pair,
    extent_of,
    gait_motions,
    sweep_ramps,
)
from observer.mechanism.mechanism import WorkspaceError, singularity_ratio
from observer.mechanism.parameters import LegParameters

EDGE_POINTS: Final = 61
GAIT_PHASES: Final = 240


def limit_box(limits: Limits) -> Box:
    """Hard position limits in rad and m."""
    hip, slide = limits.hip, limits.slide
    return Box(
        (math.radians(hip.position_min_deg), slide.position_min_m),
        (math.radians(hip.position_max_deg), slide.position_max_m),
    )


def soft_box(limits: Limits) -> Box:
    """Position limits less the soft margins in rad and m."""
    hard = limit_box(limits)
    hip, slide = math.radians(limits.hip.soft_margin_deg), limits.slide.soft_margin_m
    return Box(
        (hard.low[0] + hip, hard.low[1] + slide),
        (hard.high[0] - hip, hard.high[1] - slide),
    )


def decelerations(limits: Limits) -> Pair:
    """Decelerations of the quick stop, rad/s^2 and m/s^2."""
    return (
        limits.hip.quick_stop_deceleration_rad_per_s2,
        limits.slide.quick_stop_deceleration_m_per_s2,
    )


def mean_pose(settings: Settings, leg: LegParameters) -> Pair:
    """The gait's mean pose, about which excitations run: rad, m."""
    return joints_of_angles(leg, gait_angles(gait_shape(settings.trainer.gait), 0.0, 0.0))


def every_limit_can_be_reached(settings: Settings) -> Errors:
    """Each position limit is one that the mechanism reaches in some pose."""
    leg, box = leg_parameters(settings.robot), limit_box(settings.limits)
    soft_ratio = settings.limits.singularity.soft_ratio
    hips = np.linspace(box.low[0], box.high[0], EDGE_POINTS)
    slides = np.linspace(box.low[1], box.high[1], EDGE_POINTS)
    limits = settings.limits
    edges = (
        ("hip.position_min_deg", limits.hip.position_min_deg, [(hips[0], s) for s in slides]),
        ("hip.position_max_deg", limits.hip.position_max_deg, [(hips[-1], s) for s in slides]),
        ("slide.position_min_m", limits.slide.position_min_m, [(h, slides[0]) for h in hips]),
        ("slide.position_max_m", limits.slide.position_max_m, [(h, slides[-1]) for h in hips]),
    )
    for key, value, poses in edges:
        best = max(float(singularity_ratio(leg, np.array(pose))) for pose in poses)
        if best < soft_ratio:
            allowed = (
                "a position that the mechanism reaches with some position of the other axis inside "
                f"its limits; here |sin| of shank and shoe is {best:.2f} at best, {soft_ratio:g} "
                "is needed"
            )
            yield ConfigError(settings.file.limits, key, value, allowed)


def the_gait_fits(settings: Settings) -> Errors:
    """The gait at its highest cadence is possible, inside the limits, and can be stopped."""
    leg, gait = leg_parameters(settings.robot), settings.trainer.gait
    try:
        mean_pose(settings, leg)  # which need not be part of the gait
        motions = gait_motions(leg, gait, gait.cadence_max_hz, GAIT_PHASES)
    except WorkspaceError as error:
        allowed = f"a gait that the mechanism of {settings.file.robot} can do: {error}"
        yield ConfigError(
            settings.file.path, "gait.knee.harmonics_deg", gait.knee.harmonics_deg, allowed
        )
        return
    extent = extent_of(leg, [motion.position for motion in motions])
    errors = [*_gait_inside_limits(settings, extent), *_gait_not_too_fast(settings, motions)]
    yield from errors
    if not errors:
        yield from _gait_can_be_stopped(settings, leg, motions)


def _gait_inside_limits(settings: Settings, extent: Extent) -> Errors:
    box, file = soft_box(settings.limits), settings.file
    spans = (
        ("gait.hip.harmonics_deg", "hip", 180.0 / math.pi, "deg"),
        ("gait.knee.harmonics_deg", "slide", 1.0, "m"),
    )
    for axis, (key, name, scale, unit) in enumerate(spans):
        low, high = extent.low[axis] * scale, extent.high[axis] * scale
        least, most = box.low[axis] * scale, box.high[axis] * scale
        if low < least or high > most:
            value = PlainText(f"({name} {low:.4g} to {high:.4g} {unit})")
            allowed = f"{least:.4g} to {most:.4g} {unit}, the limits of {file.limits} less margins"
            yield ConfigError(file.path, key, value, allowed)
    soft_ratio = settings.limits.singularity.soft_ratio
    if extent.least_singularity_ratio < soft_ratio:
        value = PlainText(f"(|sin| of shank and shoe {extent.least_singularity_ratio:.3f})")
        allowed = f">= singularity.soft_ratio = {soft_ratio:g}"
        yield ConfigError(file.path, "gait.knee.harmonics_deg", value, allowed)


def _gait_not_too_fast(settings: Settings, motions: tuple[Motion, ...]) -> Errors:
    gait, limits = settings.trainer.gait, settings.limits
    peaks = (max(abs(motion.velocity[axis]) for motion in motions) for axis in (0, 1))
    most = limits.hip.velocity_max_rad_per_s, limits.slide.velocity_max_m_per_s
    share, speed = min(
        (limit / peak if peak else math.inf, f"{limit:g} {unit}")
        for limit, peak, unit in zip(most, peaks, ("rad/s", "m/s"), strict=True)
    )
    if share < 1:
        allowed = f"<= {gait.cadence_max_hz * share:.3g}, where the leg reaches {speed}"
        yield ConfigError(settings.file.path, "gait.cadence_max_hz", gait.cadence_max_hz, allowed)


def _gait_can_be_stopped(
    settings: Settings, leg: LegParameters, motions: tuple[Motion, ...]
) -> Errors:
    box, limits = limit_box(settings.limits), settings.limits
    extent = sweep_ramps(leg, motions, decelerations(limits)).extent
    stop_ratio = limits.singularity.stop_ratio
    if extent.inside(box) and extent.least_singularity_ratio >= stop_ratio:
        return
    key, value = "gait.cadence_max_hz", settings.trainer.gait.cadence_max_hz
    allowed = (
        f"a cadence whose quick stops stay inside the limits; now they reach {extent_text(extent)}"
    )
    yield ConfigError(settings.file.path, key, value, allowed)


def _scenarios_are_well_formed(settings: Settings) -> Errors:
    for name, scenario in settings.trainer.excite.items():
        for part_key in ("torque", "artificial"):
            parts: tuple[Sinusoid, ...] = getattr(scenario, part_key)
            for index, part in enumerate(parts):
                key = f"excite.{name}.{part_key}[{index}]"
                yield from _part_is_well_formed(settings, key, part, scenario)


def _part_is_well_formed(settings: Settings, key: str, part: Sinusoid, scenario: Excite) -> Errors:
    path = settings.file.path
    if part.end_s <= part.start_s:
        yield ConfigError(path, f"{key}.end_s", part.end_s, f"> start_s = {part.start_s:g}")
    if part.start_s >= scenario.duration_max_s:
        allowed = f"< duration_max_s = {scenario.duration_max_s:g}"
        yield ConfigError(path, f"{key}.start_s", part.start_s, allowed)
    if (part.kind == "sine") != (part.frequency_hz > 0):
        allowed = "> 0 for a sine" if part.kind == "sine" else "0 for a step"
        yield ConfigError(path, f"{key}.frequency_hz", part.frequency_hz, allowed)


def scenarios_stay_inside(settings: Settings) -> Errors:
    """The window of each scenario is inside the position limits."""
    leg, box = leg_parameters(settings.robot), limit_box(settings.limits)
    middle = mean_pose(settings, leg)
    for name, scenario in settings.trainer.excite.items():
        windows = (
            ("hip.window_deg", scenario.hip.window_deg, 180.0 / math.pi),
            ("slide.window_m", scenario.slide.window_m, 1.0),
        )
        for axis, (key, value, scale) in enumerate(windows):
            room = min(middle[axis] - box.low[axis], box.high[axis] - middle[axis]) * scale
            if value > room:
                allowed = f"<= {room:.3g}: from the gait's mean pose to the nearest position limit"
                yield ConfigError(settings.file.path, f"excite.{name}.{key}", value, allowed)


def scenarios_have_the_effort(settings: Settings) -> Errors:
    """The torque of each scenario fits beside the load of the leg."""
    leg = leg_parameters(settings.robot)
    load = load_at(leg, mean_pose(settings, leg))
    most = settings.limits.hip.torque_max_nm, settings.limits.slide.force_max_n
    for name, scenario in settings.trainer.excite.items():
        for axis, (axis_name, unit) in enumerate((("hip", "N m"), ("slide", "N"))):
            peak = _peak_effort(scenario.torque, axis_name)
            room = most[axis] - abs(load[axis])
            if peak > room:
                value = PlainText(f"({axis_name} {peak:g} {unit})")
                allowed = (
                    f"<= {room:.4g} {unit} beside what holds the leg, or the torque is cut off"
                )
                yield ConfigError(settings.file.path, f"excite.{name}.torque", value, allowed)


def _peak_effort(parts: tuple[Sinusoid, ...], axis: str) -> float:
    """Largest sum of the amplitudes that act at the same time."""
    own = [part for part in parts if part.axis == axis]
    times = sorted({part.start_s for part in own} | {part.end_s for part in own})
    return max(
        (
            sum(abs(part.amplitude_si) for part in own if part.start_s <= begin < part.end_s)
            for begin, _ in pairwise(times)
        ),
        default=0.0,
    )


def self_tests_have_samples(settings: Settings) -> Errors:
    """The self-test moves each axis for long enough to average its effort between the ramps."""
    rules = settings.trainer.self_test
    ways = (
        ("hip.speed_rad_per_s", f"hip.motion_deg = {rules.hip.motion_deg:g}"),
        ("slide.speed_m_per_s", f"slide.motion_m = {rules.slide.motion_m:g}"),
    )
    for (key, motion), speed_si, distance_si in zip(
        ways, self_test.speeds(rules), self_test.distances(rules), strict=True
    ):
        most_si = self_test.speed_max(distance_si)
        if speed_si > most_si:
            allowed = (
                f"at most {most_si:g} with {motion}: a faster motion is over before its effort can "
                "be averaged"
            )
            yield ConfigError(settings.file.path, f"self_test.{key}", speed_si, allowed)


def extent_text(extent: Extent) -> str:
    """An extent in words."""
    (hip_low, slide_low), (hip_high, slide_high) = extent.low, extent.high
    return (
        f"hip {math.degrees(hip_low):.1f} to {math.degrees(hip_high):.1f} deg, "
        f"slide {slide_low:.3f} to {slide_high:.3f} m, "
        f"|sin| of shank and shoe {extent.least_singularity_ratio:.2f}"
    )


MOTION_CHECKS: Final = (
    every_limit_can_be_reached,
    the_gait_fits,
    _scenarios_are_well_formed,
    scenarios_stay_inside,
    scenarios_have_the_effort,
    self_tests_have_samples,
)
