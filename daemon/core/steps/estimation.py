"""The observer of each leg: estimate, smoothed strides, and the drift of friction.

This file makes `Estimated`. The observer, its smoother and the strides are objects that it owns.
"""

import math
from collections.abc import Iterator

from gaitd_names import EventCode
from msgspec import Struct
from msgspec.structs import replace

from daemon.core.motion.gait_shape import Pair
from daemon.core.safety import friction_monitor
from daemon.core.safety.joints import Joint
from daemon.core.slices import Advice, Estimated
from daemon.core.state import Leg, Observers
from daemon.core.steps import monitors
from daemon.core.steps.sampling import effort_std
from daemon.core.tick import Tick
from daemon.ipc.report import Event
from observer.drift import (
    SIGMAS,
    Drift,
    asks_for_calibration,
    correlation,
    friction_error,
    is_offset,
    is_sloped,
    offset_allowed,
    offset_error,
    slope_error,
)
from observer.filter.considered import Known
from observer.filter.leg_observer import LegEstimate, PoseError
from observer.filter.status import Validity
from observer.mechanism.friction import FrictionParameters


class ObserverInputs(Struct, frozen=True):
    """What the observer of a leg reads in one cycle; the hip first, then the slide."""

    joints: tuple[Joint, Joint]
    referenced: bool
    """The positions of both axes are valid."""
    origin_moved: bool
    """A homing has moved the origin of a position since the last sample."""
    artificial: Pair
    is_artificial: bool
    """The exercise has an artificial disturbance, now or later."""
    effort_std: Pair
    """Standard deviations of the efforts about their means over the cycle: N·m and N."""
    saturated: bool
    near_limit: bool
    dt_s: float
    late: bool
    known: Known
    """What a passive baseline says."""


def inputs_of(leg: Leg, tick: Tick) -> ObserverInputs:
    """Collect what the observer of a leg reads in this cycle."""
    hip, slide = leg.axes
    exercise = leg.exercise
    return ObserverInputs(
        joints=(hip.sensed.joint, slide.sensed.joint),
        referenced=hip.sensed.referenced and slide.sensed.referenced,
        origin_moved=hip.sensed.origin_moved or slide.sensed.origin_moved,
        artificial=(0.0, 0.0) if exercise is None else exercise.artificial_si,
        is_artificial=exercise is not None and exercise.is_artificial,
        effort_std=effort_std(leg),
        saturated=monitors.is_saturated(leg),
        near_limit=leg.monitored.zone.entered,
        dt_s=tick.dt_s,
        late=tick.late,
        known=leg.passive.known,
    )


def estimate(observers: Observers, before: Estimated, inputs: ObserverInputs) -> Estimated:
    """Feed a leg's observer with this cycle's samples; a missing sample is NaN.

    Where a homing has moved the origin, the observer starts anew: to it the step is no motion.
    """
    if inputs.origin_moved:
        before = cleared(before)
    if inputs.known is not observers.observer.known:
        observers.observer.take_baseline(inputs.known)
    hip, slide = inputs.joints
    measured = _sampled_si(hip), _sampled_si(slide)
    artificial = inputs.artificial
    effort_used = hip.effort_si - artificial[0], slide.effort_si - artificial[1]
    if before.estimate is None:
        sampled = inputs.referenced and hip.fresh and slide.fresh
        if not (sampled and _start(observers, measured)):
            return replace(
                before, measured=measured, effort_used=effort_used, artificial=artificial
            )
    found = observers.observer.step(
        measured,
        effort_used,
        inputs.dt_s,
        effort_std=inputs.effort_std,
        late=inputs.late,
        unreferenced=not inputs.referenced,
        artificial=inputs.is_artificial,
        input_saturated=inputs.saturated,
        near_limit=inputs.near_limit,
    )
    drifts = _drifts(before.drifts, observers.friction, found, inputs.dt_s)
    sample = observers.smoother.add(found, effort_used, inputs.dt_s)
    stride = None if sample is None else observers.strides.add(sample)
    return Estimated(
        estimate=found,
        measured=measured,
        effort_used=effort_used,
        artificial=artificial,
        bad_cycles=before.bad_cycles + 1 if Validity.BAD in found.validity else 0,
        stride=stride,
        stride_count=before.stride_count + (stride is not None),
        drifts=drifts,
        advice=(_advised(before, drifts, observers, 0), _advised(before, drifts, observers, 1)),
    )


def cleared(before: Estimated) -> Estimated:
    """Neither estimate nor stride nor samples: there are no drives, or they have just come up."""
    return Estimated(
        artificial=before.artificial,
        stride_count=before.stride_count,
        drifts=before.drifts,
        advice=before.advice,
    )


def news(leg: Leg, before: Estimated, after: Estimated) -> Iterator[Event]:
    """Advice to calibrate an axis of an empty machine, once for each reason.

    A patient who pushes with the motion looks like low friction.
    """
    for index, axis in enumerate(leg.axes):
        old, new, drift = before.advice[index], after.advice[index], after.drifts[index]
        if new.friction and not old.friction:
            numbers = friction_error(drift), correlation(drift)
            yield Event(EventCode.CALIBRATION_ADVISED, axis.name, numbers)
        if new.offset and not old.offset:
            numbers = offset_error(drift), offset_allowed(drift)
            yield Event(EventCode.OFFSET_FOUND, axis.name, numbers)
        if new.slope and not old.slope:
            slope_std = leg.observers.slope_std or (math.nan, math.nan)
            numbers = slope_error(drift, leg.observers.friction[index]), SIGMAS * slope_std[index]
            yield Event(EventCode.SLOPE_FOUND, axis.name, numbers)


def _start(observers: Observers, measured: Pair) -> bool:
    """Start the observer at the measured pose; False if that pose is impossible.

    Without an observer the drives cannot be enabled.
    """
    try:
        observers.observer.reset(measured)
    except PoseError:
        return False
    return True


def _sampled_si(joint: Joint) -> float:
    return joint.position_si if joint.fresh else math.nan


def _drifts(
    before: tuple[Drift, Drift],
    friction: tuple[FrictionParameters, FrictionParameters],
    found: LegEstimate,
    dt_s: float,
) -> tuple[Drift, Drift]:
    hip = friction_monitor.update(before[0], friction[0], found, 0, dt_s)
    slide = friction_monitor.update(before[1], friction[1], found, 1, dt_s)
    return hip or before[0], slide or before[1]


def _advised(
    before: Estimated, drifts: tuple[Drift, Drift], observers: Observers, index: int
) -> Advice:
    """Why to calibrate an axis; a drift that has not changed is not judged again."""
    drift, law, slope_std = drifts[index], observers.friction[index], observers.slope_std
    if drift is before.drifts[index]:
        return before.advice[index]
    friction = asks_for_calibration(drift, law)
    if slope_std is None:
        return Advice(friction)
    return Advice(friction, is_offset(drift), is_sloped(drift, law, slope_std[index]))
