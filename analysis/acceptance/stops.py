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

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np
from gaitd_client.wire.fields import POWER_STATES

from analysis.acceptance.record import Judgement, Line, StopTrace
from daemon.ipc.record import Cause, CycleRecord, DriveRecord, StopCategory

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


class StopRules(NamedTuple):
    """What the configuration allows one axis; SI units at the joint."""

    deceleration_si_per_s2: float
    standstill_si_per_s: float
    standstill_cycles: int
    obey_s: float
    hold_obey_s: float
    """As `obey_s`, for a hold by the core, S2."""
    margin_ratio: float
    effort_free_si: float
    """Largest measured effort that counts as none."""
    position_unit: str
    effort_unit: str


class MeasuredStop(NamedTuple):
    """One stop of one axis."""

    category: StopCategory
    cause: Cause
    """Cause of the most severe verdict: STO is an EMCY, S1, before a sample shows its contact."""
    disobeyed: bool
    """The stop had to be escalated because this axis did not obey."""
    speed_si_per_s: float
    """At the verdict."""
    reaction_s: float | None
    """Until the drive shows that it brakes (S1) or has no torque (S0)."""
    trace: StopTrace


class NoStopError(Exception):
    """The records hold no stop of this axis."""


def measure(records: Sequence[CycleRecord], axis: str, rules: StopRules) -> MeasuredStop:
    """Measure the first stop in the records.

    Args:
        records: in order, from before the stop.
        axis: LEG/AXIS.
        rules: of this axis.

    Raises:
        NoStopError: there is none, or no sample of the axis at it.
    """
    stopped = next((record for record in records if record.verdict.category), None)
    if stopped is None:
        raise NoStopError("no stop was seen")
    rows = [
        ((record.sync_mono_ns - stopped.sync_mono_ns) / 1e9, _drive(record, axis))
        for record in records
    ]
    rows = [row for row in rows if row[0] >= -BEFORE_S]
    at_stop = _drive(stopped, axis)
    if at_stop.velocity_si is None or at_stop.position_si is None:
        raise NoStopError("there was no sample of it when it stopped")
    after = [row for row in rows if row[0] >= 0]
    last = records[-1].verdict
    verdict = [one.verdict for one in records if one.verdict.cause is not Cause.STOP_NOT_OBEYED][-1]
    category = verdict.category
    shown = TORQUELESS if category is StopCategory.S0 else BRAKING_BY_DRIVE
    rest_s = _rest_s(after, rules)
    trace = StopTrace(
        title=f"{category.name}, {verdict.cause.name.lower()}",
        position_unit=rules.position_unit,
        effort_unit=rules.effort_unit,
        time_s=tuple(time_s for time_s, _ in rows),
        position_si=tuple(drive.position_si for _, drive in rows),
        velocity_si_per_s=tuple(drive.velocity_si for _, drive in rows),
        effort_si=tuple(drive.effort_si for _, drive in rows),
        rest_s=rest_s,
        distance_si=None if rest_s is None else _way_si(after, rest_s, at_stop.position_si),
    )
    return MeasuredStop(
        category=category,
        cause=verdict.cause,
        disobeyed=last.cause is Cause.STOP_NOT_OBEYED and last.drive in {"", axis},
        speed_si_per_s=abs(at_stop.velocity_si),
        reaction_s=next((t for t, drive in after if _state(drive) in shown), None),
        trace=trace,
    )


def judge(stop: MeasuredStop, wanted: StopCategory, rules: StopRules) -> Iterator[Line]:
    """The lines of a stop."""
    judged = _judgement(stop.category is wanted and not stop.disobeyed)
    text = f"{stop.category.name} by {stop.cause.name.lower()}"
    if stop.disobeyed:
        text += ", not obeyed by the drive"
    yield Line("category of the stop", text, f"{wanted.name}, obeyed by the drive", judged)
    speed = f"{stop.speed_si_per_s:.3g} {rules.position_unit}/s"
    yield Line("speed when it began", speed, "any", Judgement.NOTED)
    if stop.category is not StopCategory.S2:
        yield _at_most(
            "until the drive shows that it stops", stop.reaction_s, rules.obey_s, 1e3, "ms"
        )
    if stop.category is StopCategory.S0:
        yield from _without_power(stop, rules)
        return
    obey_s = rules.hold_obey_s if stop.category is StopCategory.S2 else rules.obey_s
    fastest = _fastest_si_per_s(stop.trace, obey_s)
    if fastest <= rules.standstill_si_per_s:
        why = f"it was at rest: at most {fastest:.3g} {rules.position_unit}/s"
        yield Line("time and way until rest", why, "a stop in motion", Judgement.NOT_MEASURED)
        return
    on_ramp_s = rules.margin_ratio * fastest / rules.deceleration_si_per_s2
    yield _at_most("time until rest", stop.trace.rest_s, obey_s + on_ramp_s, 1e3, "ms")
    yield _at_most(
        "way until rest",
        stop.trace.distance_si,
        fastest * (obey_s + 0.5 * on_ramp_s),
        1.0,
        rules.position_unit,
    )
    if stop.category is StopCategory.S1:
        yield _slope_line(stop, rules)


def _fastest_si_per_s(trace: StopTrace, obey_s: float) -> float:
    """The largest speed from the verdict until the axis must obey."""
    samples = zip(trace.time_s, trace.velocity_si_per_s, strict=True)
    return max(abs(speed) for t, speed in samples if 0 <= t <= obey_s and speed is not None)


def _without_power(stop: MeasuredStop, rules: StopRules) -> Iterator[Line]:
    trace = stop.trace
    rows = list(zip(trace.time_s, trace.position_si, trace.effort_si, strict=True))
    efforts = [abs(effort) for t, _, effort in rows if t > rules.obey_s and effort is not None]
    effort_si = max(efforts, default=None)
    asked = "largest effort after that"
    yield _at_most(asked, effort_si, rules.effort_free_si, 1.0, rules.effort_unit)
    known = [position for t, position, _ in rows if 0 <= t <= FREE_S and position is not None]
    way = f"{max(abs(one - known[0]) for one in known):.3g} {rules.position_unit}"
    yield Line(f"way without power in {FREE_S:g} s", way, "nothing brakes it", Judgement.NOTED)


def _slope_line(stop: MeasuredStop, rules: StopRules) -> Line:
    """The slope of the speed, which shows the ramp better than time and way do."""
    asked = "quick-stop ramp"
    unit = f"{rules.position_unit}/s²"
    least = rules.deceleration_si_per_s2 / rules.margin_ratio
    allowed = f"at least {least:.3g} {unit} ({rules.deceleration_si_per_s2:.3g} is configured)"
    low, high = (share * stop.speed_si_per_s for share in RAMP_SHARES)
    rest_s = stop.trace.rest_s
    rows = [
        (t, abs(speed))
        for t, speed in zip(stop.trace.time_s, stop.trace.velocity_si_per_s, strict=True)
        if t > 0 and speed is not None and low <= abs(speed) <= high
        if rest_s is None or t <= rest_s
    ]
    if len(rows) < SLOPE_SAMPLES_MIN:
        why = f"too slow for the cycle: {len(rows)} samples on the ramp"
        return Line(asked, why, allowed, Judgement.NOT_MEASURED)
    times, speeds = np.array(rows).T
    slope = -float(np.polyfit(times, speeds, 1)[0])
    return Line(asked, f"{slope:.3g} {unit}", allowed, _judgement(slope >= least))


def _rest_s(rows: Sequence[tuple[float, DriveRecord]], rules: StopRules) -> float | None:
    """Time of the first of enough cycles at rest; None if there is none."""
    since_s: float | None = None
    count = 0
    for time_s, drive in rows:
        speed = drive.velocity_si
        if speed is None or abs(speed) > rules.standstill_si_per_s:
            since_s, count = None, 0
            continue
        since_s, count = time_s if since_s is None else since_s, count + 1
        if count >= rules.standstill_cycles:
            return since_s
    return None


def _way_si(rows: Sequence[tuple[float, DriveRecord]], rest_s: float, position_si: float) -> float:
    """The largest distance from a position until rest: a hold comes back part of its way."""
    return max(
        abs(drive.position_si - position_si)
        for time_s, drive in rows
        if time_s <= rest_s and drive.position_si is not None
    )


def _at_most(asked: str, value: float | None, limit: float, scale: float, unit: str) -> Line:
    allowed = f"at most {limit * scale:.3g} {unit}"
    if value is None:
        return Line(asked, "not in the time that was recorded", allowed, Judgement.FAILED)
    measured = f"{value * scale:.3g} {unit}"
    return Line(asked, measured, allowed, _judgement(value <= limit + 1e-9))


def _judgement(good: bool) -> Judgement:
    return Judgement.PASSED if good else Judgement.FAILED


def _drive(record: CycleRecord, axis: str) -> DriveRecord:
    return next(drive for drive in record.drives if drive.name == axis)


def _state(drive: DriveRecord) -> str:
    return POWER_STATES[drive.power_state]
