"""The minute with a passive patient: its strides, its baseline, and what the observer takes of it.

    gait requested with `baseline`  the old baseline is no longer in force
    strides while the gait plays    but the first ones, in which it grows
    MINUTE_S of strides, or the     the baseline is in force, or the finding says why there is none
    end of the gait

What is known fades, and widens in another gait or guidance, on another day, and at other
temperatures of the drives (`observer/baseline.py`): from the end of the next stride on. A homing
moves the origin of a position, and another drive shows other efforts: after either there is no
baseline any more.

This file makes `Passive`.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from gaitd_names import EventCode, Finding, Mode, Stage
from msgspec.structs import replace

from daemon.core.period import PERIOD_S
from daemon.core.slices import Passive
from daemon.core.state import Leg
from daemon.ipc.report import Event
from observer.baseline import (
    FADE_S,
    LONG_AGO,
    Baseline,
    NotPassiveError,
    PassiveStrides,
    Since,
    Unfit,
    is_other,
    is_other_gait,
    known,
    swing_of,
)
from observer.filter.considered import NOTHING_KNOWN
from observer.strides import Stride

MINUTE_S: Final = 60.0
AGE_STEP_S: Final = 20.0
"""What is known is computed anew after this long: it fades slowly."""
DAY_S: Final = 4 * 3600.0
"""A training does not last so long: a later one is of another day."""
TEMPERATURE_CHANGE_MAX_K: Final = 10.0
"""Change of a power stage. Chosen: friction and torque constant follow the motor's temperature,
which no drive sends."""
_FINDINGS: Final[Mapping[Unfit, Finding]] = {
    Unfit.FEW_STRIDES: Finding.FEW_STRIDES,
    Unfit.FEW_SAMPLES: Finding.FEW_SAMPLES,
    Unfit.NOT_PASSIVE: Finding.NOT_PASSIVE,
    Unfit.IMPLAUSIBLE: Finding.IMPLAUSIBLE,
}


def from_file(baseline: Baseline | None) -> Passive:
    """What a baseline says that was taken an unknown time ago."""
    return _in_force(Passive(baseline=baseline), LONG_AGO)


def begun(leg: Leg, ramp_strides: float) -> Passive:
    """Begin the minute: until it is over nothing is known. The gait grows for `ramp_strides`."""
    growing = math.ceil(ramp_strides)
    return Passive(strides=PassiveStrides(leg.observers.frictional), growing_strides=growing)


def advance(leg: Leg, before: Passive, mode: Mode, cycle: int) -> Passive:
    """Take the stride that was completed in this cycle, and end the minute if it is over.

    Args:
        leg: its estimate, strides and exercise are read.
        before: of the last cycle.
        mode: of the machine.
        cycle: the number of this cycle.
    """
    if any(axis.sensed.origin_moved for axis in leg.axes):
        return Passive()
    stride = leg.estimated.stride
    if before.strides is not None:
        return _minute(leg, before, before.strides, mode, cycle)
    if stride is None or before.baseline is None:
        return before
    since = _since(leg, before, stride, before.baseline, cycle)
    return before if since == before.since else _in_force(before, since)


def _since(leg: Leg, before: Passive, stride: Stride, baseline: Baseline, cycle: int) -> Since:
    swing_rad = swing_of(leg.observers.strides.completed)
    other_gait = is_other_gait(baseline, stride.cadence_hz, swing_rad)
    if before.taken_cycle is None:
        return LONG_AGO._replace(other_gait=other_gait)
    age_s = (cycle - before.taken_cycle) * PERIOD_S
    return Since(
        age_s=min(int(age_s / AGE_STEP_S) * AGE_STEP_S, FADE_S),
        other_gait=other_gait or is_other(leg.guidance_ratio, before.guidance_ratio),
        other_day=age_s >= DAY_S or _is_other_temperature(leg, before),
    )


def _is_other_temperature(leg: Leg, before: Passive) -> bool:
    """True if a drive is warmer or colder; as before where one does not say it any more."""
    pairs = list(zip(_temperatures_degc(leg), before.temperatures_degc, strict=True))
    is_changed = any(
        now is not None and then is not None and abs(now - then) > TEMPERATURE_CHANGE_MAX_K
        for now, then in pairs
    )
    is_lost = any(now is None and then is not None for now, then in pairs)
    return is_changed or (is_lost and before.since.other_day)


def _temperatures_degc(leg: Leg) -> tuple[float | None, float | None]:
    hip, slide = (
        None if axis.sensed.feedback is None else axis.sensed.feedback.temperature_degc
        for axis in leg.axes
    )
    return hip, slide


def with_drives(leg: Leg, serial_numbers: Sequence[int]) -> Passive:
    """What is known with the drives that are brought up now; nothing with another one.

    Another drive has another torque constant and another origin. One without a serial number
    cannot be told from another; before the first bring-up no drive is known.
    """
    pairs = zip(leg.axes, serial_numbers, strict=True)
    is_replaced = any(axis.serial_number not in {0, found} for axis, found in pairs)
    return Passive() if is_replaced else leg.passive


def news(leg: Leg, before: Passive, after: Passive) -> Iterator[Event]:
    """A baseline that was taken, or why there is none."""
    if before.strides is None or after.strides is not None:
        return
    if after.baseline is not None:
        numbers = after.baseline.stride_count, *after.baseline.kept_std
        yield Event(EventCode.BASELINE_TAKEN, leg.name, numbers)
    elif after.finding is not Finding.NONE:
        axis, *numbers = after.found
        yield Event(EventCode.BASELINE_REFUSED, leg.axes[axis].name, (after.finding, *numbers))


def _minute(leg: Leg, before: Passive, strides: PassiveStrides, mode: Mode, cycle: int) -> Passive:
    stride, exercise = leg.estimated.stride, leg.exercise
    if mode != Mode.GAIT or strides.duration_s >= MINUTE_S:
        return _result(leg, strides, cycle)
    if stride is None or exercise is None or exercise.stage is not Stage.PLAYING:
        return before
    if before.growing_strides > 0:
        return replace(before, growing_strides=before.growing_strides - 1)
    strides.add(stride, leg.observers.strides.completed)
    return before


def _result(leg: Leg, strides: PassiveStrides, cycle: int) -> Passive:
    try:
        baseline = strides.result()
    except NotPassiveError as error:
        found = error.axis, error.value, error.limit
        return Passive(finding=_FINDINGS[error.why], found=found)
    taken = Passive(
        baseline=baseline,
        taken_cycle=cycle,
        guidance_ratio=leg.guidance_ratio,
        temperatures_degc=_temperatures_degc(leg),
    )
    return _in_force(taken, Since())


def _in_force(passive: Passive, since: Since) -> Passive:
    if passive.baseline is None:
        return replace(passive, known=NOTHING_KNOWN)
    return replace(passive, known=known(passive.baseline, since), since=since)
