"""The observer of each leg: estimate, smoothed strides, and the drift of friction.

This file is the only writer of these fields of `Axis` and `Leg`. The smoothed state is that of 150
ms ago: it is for display; a controller gets the estimate of the present cycle.
"""

import math

from gaitd_names import EventCode

from daemon.core.safety import friction_monitor
from daemon.core.state import Axis, Core, Leg
from daemon.core.steps import monitors, single_axis
from daemon.core.steps.sampling import effort_std
from daemon.core.tick import Tick
from observer.drift import asks_for_calibration, correlation, friction_error
from observer.filter.leg_observer import PoseError
from observer.filter.status import Validity


def estimate(core: Core, tick: Tick) -> None:
    """Feed each leg's observer with this cycle's samples; a missing sample is NaN.

    Where a homing has moved the origin, the observer starts anew: to it the step is no motion.
    """
    for leg in core.legs:
        if _origin_moved(core, leg):
            _reset_leg(leg)
        hip, slide = leg.axes
        exercise = leg.exercise
        leg.artificial = (0.0, 0.0) if exercise is None else exercise.artificial_si
        leg.measured = (_sampled_si(hip), _sampled_si(slide))
        leg.effort_used = (
            hip.joint.effort_si - leg.artificial[0],
            slide.joint.effort_si - leg.artificial[1],
        )
        referenced = hip.referenced and slide.referenced
        if not leg.observer_started:
            if not (referenced and hip.joint.fresh and slide.joint.fresh):
                continue
            if not _start(leg):
                continue
        leg.estimate = found = leg.observer.step(
            leg.measured,
            leg.effort_used,
            tick.dt_s,
            effort_std=effort_std(leg),
            late=tick.late,
            unreferenced=not referenced,
            artificial=exercise is not None and exercise.is_artificial,
            input_saturated=monitors.is_saturated(leg),
            near_limit=leg.zone.entered,
        )
        _update_drift(core, leg, tick.dt_s)
        sample = leg.smoother.add(found, leg.effort_used, tick.dt_s)
        leg.stride = None if sample is None else leg.strides.add(sample)
        leg.stride_count += leg.stride is not None
        bad = Validity.BAD in found.validity
        leg.observer_bad_cycles = leg.observer_bad_cycles + 1 if bad else 0


def reset(core: Core) -> None:
    """Neither estimate nor stride nor samples: there are no drives, or they have just come up."""
    for leg in core.legs:
        _reset_leg(leg)


def _reset_leg(leg: Leg) -> None:
    leg.estimate = leg.stride = None
    leg.measured, leg.effort_used = (math.nan, math.nan), (0.0, 0.0)
    leg.observer_started, leg.observer_bad_cycles = False, 0


def _origin_moved(core: Core, leg: Leg) -> bool:
    return any(
        axis.feedback is not None and single_axis.moves_origin(core, axis, axis.feedback)
        for axis in leg.axes
    )


def _start(leg: Leg) -> bool:
    """Start the observer at the measured pose; False if that pose is impossible.

    Without an observer the drives cannot be enabled.
    """
    try:
        leg.observer.reset(leg.measured)
    except PoseError:
        return False
    leg.observer_started = True
    return True


def _sampled_si(axis: Axis) -> float:
    return axis.joint.position_si if axis.joint.fresh else math.nan


def _update_drift(core: Core, leg: Leg, dt_s: float) -> None:
    if leg.estimate is None:
        return
    for index, axis in enumerate(leg.axes):
        drift = friction_monitor.update(axis.drift, leg.friction[index], leg.estimate, index, dt_s)
        if drift is None:
            continue
        axis.drift = drift
        # A patient who pushes with the motion looks like low friction.
        advised = not core.config.patient_configured and asks_for_calibration(
            drift, leg.friction[index]
        )
        if advised and not axis.calibration_advised:
            numbers = friction_error(drift), correlation(drift)
            core.report(EventCode.CALIBRATION_ADVISED, axis.name, *numbers)
        axis.calibration_advised = advised
