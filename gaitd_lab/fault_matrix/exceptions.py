"""Cells whose expected result differs from the rest of their row, with the reason.

An exception never weakens the required stop to make a cell pass: it states why the fault cannot be
detected in that mode, or why another cause is detected first.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from enum import Enum
from types import MappingProxyType
from typing import Final, NamedTuple

from gaitd_names import Cause, Mode, StopCategory

from gaitd_lab.fault_matrix.faults import LAWS
from gaitd_lab.fault_matrix.law import LOST, S0, S1, S2, Law, goes_on, stops


class Why(Enum):
    """Reason of an exception."""

    STANDS = "the joint stands: nothing shows, but what it does when it is free again"
    STANDS_AND_JUMPS = "the joint stands; where it was moved meanwhile, its end is seen"
    STANDS_AT_SWITCH = "the joint stands: a switch stops what moves on to it, never away"
    POSE_HELD = "the pose is held against it, within the limits"
    LED_AWAY = "led away by hand: at the end of the range the estimate is not valid"
    OFFSET = "the drive's own loops move the joint by the offset"
    LAGS = "7 deg are less than a gait at 0.5 Hz lags behind against the patient"
    FADES = "no setpoint counts any more: assist fades, the machine brakes and holds"
    SLOW = "an open loop about g(q) that moves slowly: nothing need show it"
    TURNS = "an axis stands until its turn, then moves slowly; what holds it may look like a spasm"
    LED = "by hand, and slowly: it shows as far as the leg is led"
    UNGUIDED = "a hip that the drive moves slowly the other way looks moved by the patient"
    NO_POWER = "this axis has no power and stands: it shows when it is to move"
    HOMING = "a homing runs against its stop on purpose: time and current limit end what stands"
    NO_ESTIMATE = "until home is found no estimate counts: the drive's own loops move the axis"
    NO_PLAN = "no plan guides an axis alone"
    EMPTY_PUSHED = "the machine is empty: a push at it there may stop it"
    EMPTY = "the machine is empty, and little moves"
    TESTED = "that is what the test is for: it ends without a proof, or its end shows it"
    OPEN_LOOP = "an open loop moves slowly and stands at times: it shows as far as it moves"
    INTERPOLATION = "each drive stops by itself (8250h) when a target is not in time (60C2h)"
    ONE_TARGET = "one missing target may be enough (8250h); a SYNC up to 3 ms late is still sent"
    DRIVES_LOOP = (
        "the drive's own loop goes on: it shows as the reference moves, or by the other axis"
    )
    SINGULAR = "it does not begin anew near the singularity, nor with a knee bent backwards"
    TURNS_ROUND = "an open loop turns round: it stops once it moves on to it"
    STANDS_AT_FIRST = "the joint stands at first: it stops once it moves on to it"
    PATIENTS_OWN = "nothing guides the leg: a patient who moves it makes its motion"


Change = Callable[[Law], Law]
"""From the law of a row to that of a cell."""


def _unseen(*causes: Cause, by: tuple[StopCategory, ...] = ()) -> Change:
    """It may go on; these causes and categories are right as well."""
    return lambda row: replace(
        row, causes=row.causes.union(causes), categories=row.categories.union(by), may_go_on=True
    )


def _late(*causes: Cause, by: tuple[StopCategory, ...] = ()) -> Change:
    """The same, and without a bound in time."""
    return lambda row: replace(_unseen(*causes, by=by)(row), within_cycles=None)


def _is(law: Law) -> Change:
    """Another law than the row's."""
    return lambda _row: law


def _tested(row: Law) -> Law:
    late = _late(*_MOVED_ON, Cause.SPASM, Cause.SINGULARITY, by=(S0, S1, S2))
    return replace(late(row), latches=frozenset())


def _fades(row: Law) -> Law:
    return replace(row, ends_in=frozenset({Mode.HOLD}))


def _seen_by_reference(row: Law) -> Law:
    causes = row.causes | {Cause.STOPPING_PATH}
    return replace(row, causes=causes, within_cycles=HALF_STRIDE_CYCLES)


def _interpolated(row: Law) -> Law:
    causes = Cause.EMERGENCY, Cause.DRIVE_FAULT, *LOST, *row.causes
    within = None if row.by_drives else 9.0
    return replace(stops(*causes, within=within, later=tuple(row.later)), by_drives=row.by_drives)


_REVERSED: Final = ("encoder_reversed", "wrong_sign")
_JAMMED: Final = ("blocked_rotor", "brake_stuck")
_STUCK: Final = ("encoder_frozen", *_JAMMED)
_SEEN_IN_MOTION: Final = (*_STUCK, *_REVERSED)
_MOVED_ON: Final = (Cause.VELOCITY_LIMIT, Cause.ENCODER_JUMP)
"""Causes of a joint that moved while its encoder, or its motor, did not show it."""
_BY_POSITION: Final = ("hold_position", "gait_position")
_HELD: Final = ("hold", "hold_position")
_ALONE: Final = ("reference", "commission")
HALF_STRIDE_CYCLES: Final = 125.0
"""Half a stride at 0.4 Hz, in which each joint moves through its whole range.

Eight moments of the stride gave 9 to 97 cycles: the most where the joint was about to turn.
"""
_OFFSET: Final = stops(
    Cause.NOT_FOLLOWING,
    Cause.TRACKING_LIMIT,
    Cause.STOPPING_PATH,
    Cause.DRIVE_FAULT,
    Cause.EMERGENCY,
    by=(S1, S2),
    within=20.0,
)
_MISSED: Final = (
    *("deaf", "queue_full", "queue_full_once", "sync_late_6ms"),
    *("overrun_3", "overrun_6", "core_35ms"),
)
"""Faults after which a drive misses a target."""
HIP, SLIDE, BOTH = "right/hip", "right/slide", ""


class _Row(NamedTuple):
    """Cells of these faults and modes."""

    faults: tuple[str, ...]
    modes: tuple[str, ...]
    axis: str
    why: Why
    change: Change


_TABLE: Final = (
    _Row((*_REVERSED, *_JAMMED), _HELD, BOTH, Why.STANDS, _late(Cause.SPASM)),
    _Row(("encoder_frozen",), _HELD, BOTH, Why.STANDS_AND_JUMPS, _late(*_MOVED_ON)),
    _Row(("limit_switch",), _HELD, BOTH, Why.STANDS_AT_SWITCH, _unseen()),
    _Row(("spasm",), _HELD, BOTH, Why.POSE_HELD, _unseen()),
    _Row(
        ("torque_offset",),
        ("hand_guiding",),
        HIP,
        Why.LED_AWAY,
        _unseen(Cause.OBSERVER_INVALID, by=(S2,)),
    ),
    _Row(("position_offset",), ("hold_position",), BOTH, Why.OFFSET, _is(_OFFSET)),
    _Row(("position_offset",), ("gait_position",), SLIDE, Why.OFFSET, _is(_OFFSET)),
    _Row(
        ("position_offset",),
        ("gait_position",),
        HIP,
        Why.LAGS,
        _is(replace(_OFFSET, may_go_on=True, within_cycles=None)),
    ),
    _Row(
        ("zenoh_lost", "nan_setpoint", "gateway_restarted", "gateway_200ms"),
        ("torque",),
        BOTH,
        Why.FADES,
        _fades,
    ),
    _Row((*_STUCK, "limit_switch"), ("torque", "hand_guiding"), BOTH, Why.SLOW, _late(*_MOVED_ON)),
    _Row(
        (*_SEEN_IN_MOTION, "limit_switch"),
        ("self_test",),
        BOTH,
        Why.TURNS,
        _late(Cause.SELF_TEST_FAILED, Cause.VELOCITY_LIMIT, Cause.SPASM, by=(S2,)),
    ),
    _Row((*_REVERSED, "spasm"), ("hand_guiding",), BOTH, Why.LED, _late()),
    _Row(_REVERSED, ("torque",), SLIDE, Why.STANDS, _unseen()),
    _Row(_REVERSED, ("torque",), HIP, Why.UNGUIDED, _late(*_MOVED_ON)),
    _Row((*_SEEN_IN_MOTION, "limit_switch"), _ALONE, SLIDE, Why.NO_POWER, _unseen()),
    _Row((*_STUCK, "limit_switch"), ("reference",), HIP, Why.HOMING, _unseen()),
    _Row(("observer_nan_stays",), ("reference",), BOTH, Why.NO_ESTIMATE, _is(goes_on())),
    _Row(("nan_guidance",), _ALONE, BOTH, Why.NO_PLAN, _unseen()),
    _Row(
        ("voluntary_push",),
        _ALONE,
        BOTH,
        Why.EMPTY_PUSHED,
        _is(replace(stops(Cause.SPASM, Cause.VELOCITY_LIMIT), may_go_on=True)),
    ),
    _Row(("spasm",), _ALONE, BOTH, Why.EMPTY, _unseen()),
    _Row(_SEEN_IN_MOTION, ("commission",), HIP, Why.TESTED, _tested),
    _Row(_SEEN_IN_MOTION, ("excite",), HIP, Why.OPEN_LOOP, _tested),
    _Row(_SEEN_IN_MOTION, ("excite",), SLIDE, Why.OPEN_LOOP, _tested),
    _Row(_MISSED, _BY_POSITION, BOTH, Why.INTERPOLATION, _interpolated),
    _Row(
        ("overrun_1",),
        _BY_POSITION,
        BOTH,
        Why.ONE_TARGET,
        _is(replace(stops(Cause.EMERGENCY, Cause.DRIVE_FAULT, *LOST, within=9.0), may_go_on=True)),
    ),
    _Row(("encoder_frozen",), ("gait_position",), BOTH, Why.DRIVES_LOOP, _seen_by_reference),
    _Row(
        ("observer_diverged", "observer_nan"),
        ("hand_guiding",),
        BOTH,
        Why.SINGULAR,
        _is(replace(stops(Cause.OBSERVER_INVALID, by=(S2,), within=60.0), may_go_on=True)),
    ),
    _Row(("limit_switch",), ("excite",), BOTH, Why.TURNS_ROUND, _late()),
    _Row(("limit_switch",), ("commission",), HIP, Why.STANDS_AT_FIRST, _late()),
    _Row(("spasm",), ("excite",), BOTH, Why.PATIENTS_OWN, _late()),
)


def _exceptions() -> Iterator[tuple[tuple[str, str, str], Law]]:
    for faults, modes, axis, why, change in _TABLE:
        for mode in modes:
            for fault in faults:
                yield (fault, mode, axis), replace(change(LAWS[fault]), why=why.value)


EXCEPTIONS: Final[Mapping[tuple[str, str, str], Law]] = MappingProxyType(dict(_exceptions()))
"""Laws by fault, mode and axis, which is empty for both."""


def law(fault: str, mode: str, axis: str) -> Law:
    """Return the expected result of one cell; each leg has the laws of the right one."""
    axis = axis and f"right/{axis.rpartition('/')[2]}"
    own = EXCEPTIONS.get((fault, mode, axis)) or EXCEPTIONS.get((fault, mode, BOTH))
    return own or LAWS[fault]
