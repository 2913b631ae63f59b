"""A stop of one axis, measured from the raw drive values in the records of the core.

Time 0 is the cycle of the verdict, whose samples are the last before the stop is sent. Speed is the
difference of two encoder samples, so it is half a cycle old, and a drive acts at the next SYNC: the
permitted times have the cycles that the core itself gives a drive to obey.

    S1  braking on the quick-stop ramp a: time <= obey + margin v / a,
        way <= v obey + margin v^2 / 2a, slope of the speed >= a / margin
    S2  the core's hold: as above, with its longer time to obey, and no slope
    S0  no torque after the time to obey; the way is not limited, because nothing brakes

v is the largest speed until the time to obey: a person stops a gait at any phase, and near a
reversal the axis gains speed before the stop acts. An axis that was at rest has shown no braking.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np
from gaitd_client import Cause, StopCategory
from gaitd_names import POWER_STATES
from numpy.typing import NDArray

from analysis.acceptance.record import (
    Finding,
    FindingCode,
    Judgement,
    Reason,
    ReasonCode,
    Section,
    StopTrace,
    Values,
)
from daemon.ipc.record import CycleRecord, DriveRecord
from gaitd.commissioning.messages import PASSED_OR_FAILED, InstructionCode

Samples = NDArray[np.float64]
BEFORE_S: Final = 0.3
"""Part of a trace before the stop."""
RAMP_SHARES: Final = (0.15, 0.85)
"""The slope is fitted while the speed is between these shares of that at the stop."""
SLOPE_SAMPLES_MIN: Final = 3
FREE_S: Final = 1.0
"""Time after an S0 within which the way without power is given."""
TORQUELESS: Final = frozenset(
    {"not_ready_to_switch_on", "switch_on_disabled", "ready_to_switch_on", "switched_on", "fault"}
)
BRAKING_BY_DRIVE: Final = TORQUELESS | {"quick_stop_active", "fault_reaction_active"}


class WayToStop(NamedTuple):
    """A way to stop the machine."""

    category: StopCategory
    cause: Cause
    section: Section
    now: InstructionCode | None = None
    """Told when it is time; None: the stop is requested."""


STOPS: Final = (
    WayToStop(StopCategory.S2, Cause.STOP_REQUESTED, Section.STOP_BY_REQUEST),
    WayToStop(
        StopCategory.S1,
        Cause.HAND_SWITCH_OPEN,
        Section.STOP_BY_HAND_SWITCH,
        InstructionCode.OPEN_HAND_SWITCH_NOW,
    ),
    WayToStop(
        StopCategory.S0,
        Cause.STO_ACTIVE,
        Section.STOP_BY_STO,
        InstructionCode.PRESS_STO_NOW,
    ),
)
"""The ways in which the machine is stopped, mildest first."""


class StopRules(NamedTuple):
    """What the configuration allows one axis; SI units at the joint."""

    axis: str
    """LEG/AXIS."""
    deceleration_si_per_s2: float
    standstill_si_per_s: float
    standstill_cycles: int
    obey_s: float
    hold_obey_s: float
    """As `obey_s`, for a hold by the core, S2."""
    margin_ratio: float
    effort_free_si: float
    """Largest measured effort that counts as none."""


def measure(records: Sequence[CycleRecord], rules: StopRules) -> StopTrace | None:
    """Measure the first stop in the records, which begin before it.

    Returns: None if there is none, or no sample of the axis at it.
    """
    axis = rules.axis
    stopped = next((one for one in records if one.verdict.category is not StopCategory.NONE), None)
    if stopped is None:
        return None
    at_stop = drive_of(stopped, axis)
    if at_stop.velocity is None or at_stop.position is None:
        return None
    rows = [
        ((record.sync_mono_ns - stopped.sync_mono_ns) / 1e9, drive_of(record, axis))
        for record in records
    ]
    rows = [row for row in rows if row[0] >= -BEFORE_S]
    after = [row for row in rows if row[0] >= 0]
    verdicts = [one.verdict for one in records]
    verdict = [one for one in verdicts if one.cause is not Cause.STOP_NOT_OBEYED][-1]
    last, category = verdicts[-1], verdict.category
    shown = TORQUELESS if category == StopCategory.S0 else BRAKING_BY_DRIVE
    acts_s = (t for t, drive in after if POWER_STATES[drive.power_state] in shown)
    rest_s = _rest_s(after, rules)
    # A hold comes back part of its way.
    ways_si = (
        abs(drive.position - at_stop.position)
        for t, drive in after
        if rest_s is not None and t <= rest_s and drive.position is not None
    )
    return StopTrace(
        drive=axis,
        category=category,
        cause=verdict.cause,
        is_obeyed=last.cause is not Cause.STOP_NOT_OBEYED or last.drive not in {"", axis},
        speed_si_per_s=abs(at_stop.velocity),
        reaction_s=next(acts_s, None),
        time_s=tuple(time_s for time_s, _ in rows),
        position_si=tuple(drive.position for _, drive in rows),
        velocity_si_per_s=tuple(drive.velocity for _, drive in rows),
        effort_si=tuple(drive.effort for _, drive in rows),
        rest_s=rest_s,
        distance_si=max(ways_si, default=None),
    )


def _rest_s(rows: Sequence[tuple[float, DriveRecord]], rules: StopRules) -> float | None:
    """Time of the first of enough cycles at rest; None if there is none."""
    speeds = [abs(math.inf if drive.velocity is None else drive.velocity) for _, drive in rows]
    count = rules.standstill_cycles
    begins = range(len(rows) - count + 1)
    at_rest = (at for at in begins if max(speeds[at : at + count]) <= rules.standstill_si_per_s)
    return next((rows[at][0] for at in at_rest), None)


def judge(stop: StopTrace, wanted: WayToStop, rules: StopRules) -> Iterator[Finding]:
    """The findings of a stop."""

    def found(
        code: FindingCode, judged: Judgement, values: Values, why: ReasonCode | None = None
    ) -> Finding:
        reason = None if why is None else Reason(why, rules.axis, values)
        return Finding(rules.axis, wanted.section, code, judged, values, reason)

    def at_most(
        code: FindingCode, value: float | None, limit: float, unit: str = "si", scale: float = 1.0
    ) -> Finding:
        allowed = {f"limit_{unit}": limit * scale}
        if value is None:
            return found(code, Judgement.FAILED, allowed, ReasonCode.NO_SAMPLE)
        values = {**allowed, f"measured_{unit}": value * scale}
        return found(code, PASSED_OR_FAILED[value <= limit + 1e-9], values)

    columns = (stop.time_s, stop.position_si, stop.velocity_si_per_s, stop.effort_si)
    time, position, velocity, effort = (np.array(one, dtype=float) for one in columns)
    speed = np.abs(velocity)
    is_s1, is_s2 = stop.category == StopCategory.S1, stop.category == StopCategory.S2
    yield found(
        FindingCode.CATEGORY,
        PASSED_OR_FAILED[stop.category == wanted.category and stop.is_obeyed],
        {"category": stop.category, "cause": stop.cause, "category_wanted": wanted.category},
        None if stop.is_obeyed else ReasonCode.NOT_OBEYED,
    )
    yield found(FindingCode.SPEED, Judgement.NOTED, {"speed_si_per_s": stop.speed_si_per_s})
    if not is_s2:
        yield at_most(FindingCode.REACTION, stop.reaction_s, rules.obey_s, "ms", 1e3)
    if not (is_s1 or is_s2):
        efforts = effort[(time > rules.obey_s) & np.isfinite(effort)]
        largest_si = float(np.abs(efforts).max()) if efforts.size else None
        yield at_most(FindingCode.EFFORT_AFTER, largest_si, rules.effort_free_si)
        places = position[(time >= 0) & (time <= FREE_S)]
        values = {"way_si": float(np.nanmax(np.abs(places - places[0]))), "within_s": FREE_S}
        yield found(FindingCode.WAY_WITHOUT_POWER, Judgement.NOTED, values)
        return
    obey_s = rules.hold_obey_s if is_s2 else rules.obey_s
    fastest = float(np.nanmax(speed[(time >= 0) & (time <= obey_s)]))
    if fastest <= rules.standstill_si_per_s:
        yield found(FindingCode.AT_REST, Judgement.NOT_MEASURED, {"speed_si_per_s": fastest})
        return
    on_ramp_s = rules.margin_ratio * fastest / rules.deceleration_si_per_s2
    way_max_si = fastest * (obey_s + 0.5 * on_ramp_s)
    yield at_most(FindingCode.TIME_TO_REST, stop.rest_s, obey_s + on_ramp_s, "ms", 1e3)
    yield at_most(FindingCode.WAY_TO_REST, stop.distance_si, way_max_si)
    if not is_s1:
        return
    slope = _slope_si_per_s2(stop, time, speed)
    least = rules.deceleration_si_per_s2 / rules.margin_ratio
    code, configured = FindingCode.RAMP, rules.deceleration_si_per_s2
    ramp = {"least_si_per_s2": least, "configured_si_per_s2": configured}
    if slope is None:
        yield found(code, Judgement.NOT_MEASURED, ramp, ReasonCode.NO_SAMPLE)
    else:
        yield found(code, PASSED_OR_FAILED[slope >= least], {**ramp, "slope_si_per_s2": slope})


def _slope_si_per_s2(stop: StopTrace, time: Samples, speed: Samples) -> float | None:
    """Slope of the speed, which shows the ramp better than time and way do.

    Returns: None if the axis was too slow for enough samples.
    """
    low, high = (share * stop.speed_si_per_s for share in RAMP_SHARES)
    until_s = math.inf if stop.rest_s is None else stop.rest_s
    on_ramp = (time > 0) & (time <= until_s) & (low <= speed) & (speed <= high)
    if on_ramp.sum() < SLOPE_SAMPLES_MIN:
        return None
    return -float(np.polyfit(time[on_ramp], speed[on_ramp], 1)[0])


def drive_of(record: CycleRecord, name: str) -> DriveRecord:
    """A drive's part of a record."""
    return next(drive for drive in record.drives if drive.name == name)
