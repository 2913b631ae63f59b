"""Cells whose expected result differs from the rest of their row, with the reason.

An exception never weakens the required stop to make a cell pass: it states why the fault cannot be
detected in that mode, or why another cause is detected first.
"""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Final

from daemon.ipc.record import Cause, Mode, StopCategory
from gaitd_lab.fault_matrix.expected import LOST, ROWS, S0, S1, S2, Law, goes_on, stops


def _unseen(fault: str, why: str, *causes: Cause, by: tuple[StopCategory, ...] = ()) -> Law:
    """It may go on; these causes and categories are right as well."""
    row = ROWS[fault]
    return replace(
        row,
        causes=row.causes.union(causes),
        categories=row.categories.union(by),
        may_go_on=True,
        why=why,
    )


def _late(fault: str, why: str, *causes: Cause, by: tuple[StopCategory, ...] = ()) -> Law:
    """The same, and without a bound in time."""
    return replace(_unseen(fault, why, *causes, by=by), within_cycles=None)


_SEEN_IN_MOTION: Final = (
    "encoder_frozen",
    "encoder_reversed",
    "wrong_sign",
    "blocked_rotor",
    "brake_stuck",
    "limit_switch",
)
_NO_POWER: Final = "this axis has no power and stands: it shows when it is to move"
_MOVED_ON: Final = (Cause.VELOCITY_LIMIT, Cause.ENCODER_JUMP)
"""Causes of a joint that moved while its encoder, or its motor, did not show it."""
_HOMING: Final = (
    "a homing runs against its stop on purpose: what does not move is ended by the drive's own time"
    " limit, and by the current limit of the homing"
)
_TESTED: Final = "that is what the test is for: it ends without a proof, or its end shows it"
_OPEN_LOOP: Final = "an open loop moves slowly and stands at times: it shows as far as it moves"
_INTERPOLATION: Final = (
    "cyclic position: each drive watches over its own targets and stops by itself (8250h) when"
    " one does not come in time (60C2h)"
)
_NOT_GUIDED: Final = (
    "nothing guides the leg: a hip that the drive moves slowly the other way looks like one that"
    " the patient moves; the limits of motion hold it, and the daily test finds the sign"
)
HALF_STRIDE_CYCLES: Final = 125.0
"""Half a stride at 0.4 Hz, in which each joint moves through its whole range.

Eight moments of the stride gave 9 to 97 cycles: the most where the joint was about to turn.
"""
_AT_REST: Final = "the joint stands: nothing shows, but what it does when it is free again"

HELD: Final = ("hold", "hold_position")
_OFFSET: Final = replace(
    stops(
        Cause.NOT_FOLLOWING,
        Cause.TRACKING_LIMIT,
        Cause.STOPPING_PATH,
        Cause.DRIVE_FAULT,
        Cause.EMERGENCY,
        by=(S1, S2),
        within=20.0,
    ),
    why="the drive's own loops move the joint by the offset",
)

EXCEPTIONS: Final[Mapping[tuple[str, str, str], Law]] = MappingProxyType(
    {
        **{
            (fault, mode, ""): _late(fault, _AT_REST, Cause.SPASM)
            for mode in HELD
            for fault in ("encoder_reversed", "wrong_sign", "blocked_rotor", "brake_stuck")
        },
        **{
            ("encoder_frozen", mode, ""): _late(
                "encoder_frozen",
                f"{_AT_REST}; where it was moved meanwhile, its end is seen",
                *_MOVED_ON,
            )
            for mode in HELD
        },
        **{
            ("limit_switch", mode, ""): _unseen(
                "limit_switch", "the joint stands: a switch stops what moves on to it, never away"
            )
            for mode in HELD
        },
        **{
            ("spasm", mode, ""): _unseen("spasm", "the pose is held against it, within the limits")
            for mode in HELD
        },
        ("torque_offset", "hand_guiding", "right/hip"): _unseen(
            "torque_offset",
            "what the sensor shows too much is led away by hand: at the end of the range the"
            " estimate is not valid",
            Cause.OBSERVER_INVALID,
            by=(S2,),
        ),
        ("position_offset", "hold_position", ""): _OFFSET,
        ("position_offset", "gait_position", "right/slide"): _OFFSET,
        ("position_offset", "gait_position", "right/hip"): replace(
            _OFFSET,
            may_go_on=True,
            within_cycles=None,
            why="7 deg are less than a gait at 0.5 Hz lags behind against the patient",
        ),
        **{
            (fault, "torque", ""): replace(
                ROWS[fault],
                ends_in=frozenset({Mode.HOLD}),
                why="no setpoint counts any more: assist fades, the machine brakes and holds",
            )
            for fault in ("zenoh_lost", "nan_setpoint", "gateway_restarted", "gateway_200ms")
        },
        **{
            (fault, mode, ""): _late(
                fault, "an open loop about g(q) that moves slowly: nothing need show it", *_MOVED_ON
            )
            for mode in ("torque", "hand_guiding")
            for fault in ("encoder_frozen", "blocked_rotor", "brake_stuck", "limit_switch")
        },
        **{
            (fault, "self_test", ""): _late(
                fault,
                "an axis stands until its turn has come, and then moves slowly; what holds it may"
                " look like a spasm",
                Cause.SELF_TEST_FAILED,
                Cause.VELOCITY_LIMIT,
                Cause.SPASM,
                by=(S2,),
            )
            for fault in _SEEN_IN_MOTION
        },
        **{
            (fault, "hand_guiding", ""): _late(
                fault, "by hand, and slowly: it shows as far as the leg is led"
            )
            for fault in ("encoder_reversed", "wrong_sign", "spasm")
        },
        **{
            (fault, "torque", "right/slide"): _unseen(fault, _AT_REST)
            for fault in ("encoder_reversed", "wrong_sign")
        },
        **{
            (fault, "torque", "right/hip"): _late(fault, _NOT_GUIDED, *_MOVED_ON)
            for fault in ("encoder_reversed", "wrong_sign")
        },
        **{
            (fault, mode, "right/slide"): _unseen(fault, _NO_POWER)
            for mode in ("reference", "commission")
            for fault in _SEEN_IN_MOTION
        },
        **{
            (fault, "reference", "right/hip"): _unseen(fault, _HOMING)
            for fault in ("encoder_frozen", "blocked_rotor", "brake_stuck", "limit_switch")
        },
        ("observer_nan_stays", "reference", ""): goes_on(
            "until home is found the pose is in doubt and no estimate counts: the drive's own loops"
            " move the axis"
        ),
        **{
            ("nan_guidance", mode, ""): _unseen("nan_guidance", "no plan guides an axis alone")
            for mode in ("reference", "commission")
        },
        **{
            ("voluntary_push", mode, ""): replace(
                stops(Cause.SPASM, Cause.VELOCITY_LIMIT, by=(S1,)),
                may_go_on=True,
                why="the machine is empty: a push at it there may stop it",
            )
            for mode in ("reference", "commission")
        },
        **{
            ("spasm", mode, ""): _unseen("spasm", "the machine is empty, and little moves")
            for mode in ("reference", "commission")
        },
        **{
            (fault, mode, axis): replace(
                _late(fault, why, *_MOVED_ON, Cause.SPASM, Cause.SINGULARITY, by=(S0, S1, S2)),
                latches=frozenset(),
            )
            for mode, axis, why in (
                ("commission", "right/hip", _TESTED),
                ("excite", "right/hip", _OPEN_LOOP),
                ("excite", "right/slide", _OPEN_LOOP),
            )
            for fault in _SEEN_IN_MOTION
            if fault != "limit_switch"
        },
        **{
            (fault, mode, ""): replace(
                stops(
                    Cause.EMERGENCY,
                    Cause.DRIVE_FAULT,
                    *LOST,
                    *ROWS[fault].causes,
                    within=None if ROWS[fault].by_drives else 9.0,
                    later=tuple(ROWS[fault].later),
                ),
                by_drives=ROWS[fault].by_drives,
                why=_INTERPOLATION,
            )
            for mode in ("hold_position", "gait_position")
            for fault in (
                "deaf",
                "queue_full",
                "queue_full_once",
                "sync_late_6ms",
                "overrun_3",
                "overrun_6",
                "core_35ms",
            )
        },
        **{
            ("overrun_1", mode, ""): replace(
                stops(Cause.EMERGENCY, Cause.DRIVE_FAULT, *LOST, within=9.0),
                may_go_on=True,
                why=f"{_INTERPOLATION}: a SYNC up to 3 ms late is sent, a later one is left out,"
                " and one missing target is enough; the moment of the delay in its cycle decides",
            )
            for mode in ("hold_position", "gait_position")
        },
        ("encoder_frozen", "gait_position", ""): replace(
            ROWS["encoder_frozen"],
            causes=ROWS["encoder_frozen"].causes | {Cause.STOPPING_PATH},
            within_cycles=HALF_STRIDE_CYCLES,
            why="the drive's own loop goes on: where the joint turns, nothing is lost at once, and"
            " it shows as far as the reference moves away, or by the other axis",
        ),
        **{
            (fault, "hand_guiding", ""): replace(
                stops(Cause.OBSERVER_INVALID, by=(S2,), within=60.0),
                may_go_on=True,
                why="it does not begin anew near the singularity, nor with a knee bent backwards:"
                " a leg that is led there for longer is stopped",
            )
            for fault in ("observer_diverged", "observer_nan")
        },
        ("limit_switch", "excite", ""): _late(
            "limit_switch", "an open loop turns round: it stops once it moves on to it"
        ),
        ("limit_switch", "commission", "right/hip"): _late(
            "limit_switch", "the joint stands at first: it stops once it moves on to it"
        ),
        ("spasm", "excite", ""): _late(
            "spasm", "nothing guides the leg: a patient who moves it makes its motion"
        ),
    }
)
"""(fault, mode, axis): axis empty for both."""


def law(fault: str, mode: str, axis: str) -> Law:
    """Return the expected result of one cell."""
    return EXCEPTIONS.get((fault, mode, axis)) or EXCEPTIONS.get((fault, mode, "")) or ROWS[fault]
