"""Names of the values of events, refusals and progress (`daemon/ipc/report.py`), in their order.

A name ends in its unit, or is a key of `ENUMS`: then the value is the number of a member of that
enum.
"""

from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import Final

from daemon.ipc.cycle_timing import CyclePart
from daemon.ipc.record import Cause, Mode, RequestKind, Role, Stage, StopCategory, Verdict
from daemon.ipc.report import (
    AxisStep,
    Doubt,
    Event,
    EventCode,
    Failure,
    Finding,
    MotionPhase,
    Progress,
    ProgressCode,
    RefusalCode,
    SelfTestDue,
    Trigger,
    Untested,
)
from daemon.wire.names import NmtState, PowerState, name_of

VERDICT_FIELDS: Final = ("category", "cause", "value", "limit", "finding")
_SELF_TEST: Final = (
    "friction_si",
    "friction_ratio",
    "load_error_si",
    "moved_si",
    "finding",
    "value",
    "limit",
)
_SIGN_TEST: Final = ("effort_forth_si", "moved_forth_si", "effort_back_si", "moved_back_si")
_REQUEST: Final = ("request", "mode")

EVENT_FIELDS: Final[Mapping[EventCode, tuple[str, ...]]] = {
    EventCode.BRING_UP_BEGUN: (),
    EventCode.DRIVES_UP: (),
    EventCode.NOT_REFERENCED: ("doubt",),
    EventCode.BRING_UP_FAILED: ("cause",),
    EventCode.DRIVE_HOLDS: ("power_state",),
    EventCode.FOUND_WITH_ERROR: ("emcy_code",),
    EventCode.EMCY_IN_BRING_UP: ("emcy_code",),
    EventCode.BUS_LOAD: ("busy_ratio", "busy_max_ratio", "burst_s"),
    EventCode.MODE_CHANGED: ("mode_before", "mode", "trigger"),
    EventCode.STAGE_CHANGED: ("mode", "stage", "failure"),
    EventCode.STOPPED: VERDICT_FIELDS,
    EventCode.FURTHER_CAUSE: VERDICT_FIELDS,
    EventCode.CAUSE_FOUND: VERDICT_FIELDS,
    EventCode.STILL_LATCHED: (*VERDICT_FIELDS, "latched_utc_s"),
    EventCode.REQUEST_RECEIVED: _REQUEST,
    EventCode.REQUEST_REFUSED: (*_REQUEST, "refusal"),  # and the values of the refusal
    EventCode.REQUEST_DONE: _REQUEST,
    EventCode.LEASE_DROPPED: ("role",),
    EventCode.RELOAD_REFUSED: (),
    EventCode.REFERENCE_LOST: ("doubt",),
    EventCode.TEMPERATURE_OVERDUE: (),
    EventCode.TEMPERATURE_BACK: (),
    EventCode.CLONUS_BEGUN: (),
    EventCode.CALIBRATION_ADVISED: ("friction_error_si", "correlation"),
    EventCode.TESTS_FORGOTTEN: (),
    EventCode.CLOCK_SET_BACK: ("back_s",),
    EventCode.SELF_TEST_PASSED: _SELF_TEST,
    EventCode.SELF_TEST_FAILED: _SELF_TEST,
    EventCode.SIGN_TESTED: _SIGN_TEST,
    EventCode.SIGN_PROVEN: _SIGN_TEST,
    EventCode.HOMED: (),
    EventCode.SINGLE_AXIS_BEGUN: ("mode",),
    EventCode.SINGLE_AXIS_FAILED: ("failure",),
    EventCode.CYCLES_MISSED: ("missed_count", "part"),
    EventCode.MEMORY_NOT_LOCKED: ("limit_bytes",),
    EventCode.PROCESSORS_REFUSED: (),
    EventCode.PRIORITY_REFUSED: ("priority", "priority_max"),
    EventCode.STATES_REFUSED: ("refused_count",),
    EventCode.RECORDS_SHORTENED: ("shortened_count",),
    EventCode.STATES_CROWDED: ("crowded_count",),
    EventCode.CAN_ACTIVE: (),
    EventCode.CAN_WARNING: (),
    EventCode.CAN_PASSIVE: (),
    EventCode.CAN_OFF: (),
    EventCode.CAN_ALONE: (),
    EventCode.CAN_FRAMES_LOST: ("lost_count",),
    EventCode.CAN_FOREIGN_MASTER: ("frame_count",),
}
VERDICTS: Final = frozenset(
    code for code, names in EVENT_FIELDS.items() if names[:5] == VERDICT_FIELDS
)
"""Events that report a verdict; their subject is its drive."""
_RANGE: Final = ("wanted", "lowest", "highest")
_ABOVE: Final = ("wanted", "highest")
REFUSAL_FIELDS: Final[Mapping[RefusalCode, tuple[str, ...]]] = {
    # In an event they are beside those of the request: `request` and `mode` are what was asked.
    RefusalCode.NO_SUCH_MODE: ("mode",),
    RefusalCode.NOT_IN_THIS_MODE: ("trigger", "mode_now"),
    RefusalCode.NOT_HOLDING_YET: (),
    RefusalCode.GUIDANCE_BY_POSITION: (),
    RefusalCode.SELF_TEST_DUE: ("self_test_due",),
    RefusalCode.GATEWAY_SILENT: (),
    RefusalCode.HAND_SWITCH_OPEN: (),
    RefusalCode.HAND_SWITCH_UNKNOWN: (),
    RefusalCode.STO_ACTIVE: (),
    RefusalCode.SIGN_NOT_PROVEN: (),
    RefusalCode.NOT_REFERENCED: ("doubt",),
    RefusalCode.INPUT_UNTESTED: ("untested",),
    RefusalCode.NO_SAMPLE: (),
    RefusalCode.LEG_MOVES: (),
    RefusalCode.OUTSIDE_RANGE: (),
    RefusalCode.PATIENT_CONFIGURED: (),
    RefusalCode.NO_CLEAR_WAY: (),
    RefusalCode.NO_ROOM: (),
    RefusalCode.STOPPED: VERDICT_FIELDS,
    RefusalCode.ROLE_MAY_NOT: ("role", "request"),
    RefusalCode.ROLE_MAY_NOT_MODE: ("role", "mode"),
    RefusalCode.NO_PLAN: (),
    RefusalCode.CADENCE_ABOVE_PLAN: _ABOVE,
    RefusalCode.AMPLITUDE_ABOVE_PLAN: _ABOVE,
    RefusalCode.DURATION_ABOVE_PLAN: _ABOVE,
    RefusalCode.LEASE_NEEDED: (),
    RefusalCode.LEASE_HELD: (),
    RefusalCode.BUSY: ("open_request",),
    RefusalCode.OLD: ("for_cycle", "cycle"),
    RefusalCode.STOP_REQUESTED: (),
    RefusalCode.CADENCE_OUT_OF_RANGE: _RANGE,
    RefusalCode.AMPLITUDE_OUT_OF_RANGE: _RANGE,
    RefusalCode.DURATION_OUT_OF_RANGE: _RANGE,
    RefusalCode.NO_SUCH_SCENARIO: (),
    RefusalCode.NO_SUCH_AXIS: (),
    RefusalCode.NOT_TESTED: (),
    RefusalCode.NO_HOMING: (),
    RefusalCode.FAILED: ("failure",),
}
PROGRESS_FIELDS: Final[Mapping[ProgressCode, tuple[str, ...]]] = {
    ProgressCode.SETTING_UP: ("done_count", "total_count"),
    ProgressCode.COMPARING_LOAD: (),
    ProgressCode.EXERCISING: ("elapsed_s",),
    ProgressCode.GUIDED_BY_HAND: ("left_s",),
    ProgressCode.TESTING: ("phase",),
    ProgressCode.ONE_AXIS: ("step",),
}
ENUMS: Final[Mapping[str, type[IntEnum]]] = {
    "category": StopCategory,
    "cause": Cause,
    "doubt": Doubt,
    "failure": Failure,
    "finding": Finding,
    "mode": Mode,
    "mode_before": Mode,
    "mode_now": Mode,
    "nmt_state": NmtState,
    "open_request": RequestKind,
    "part": CyclePart,
    "phase": MotionPhase,
    "power_state": PowerState,
    "refusal": RefusalCode,
    "request": RequestKind,
    "role": Role,
    "self_test_due": SelfTestDue,
    "stage": Stage,
    "step": AxisStep,
    "trigger": Trigger,
    "untested": Untested,
}


def named_values(names: Sequence[str], values: Sequence[float]) -> dict[str, float | str]:
    """Values of a report by name; members of enums by theirs, those of another version as numbers.

    A core of another version may send more values, or fewer: those without a name are left out.
    """
    return {
        name: next((_name_of(one) for one in ENUMS.get(name, ()) if one == value), value)
        for name, value in zip(names, values, strict=False)
    }


def _name_of(member: IntEnum) -> str:
    """A category keeps its capital: S1."""
    return member.name if isinstance(member, StopCategory) and member else name_of(member)


def event_line(event: Event) -> str:
    """An event as code, subject and named values, for the log of a process without texts."""
    return _line(event.code, event.subject, EVENT_FIELDS[event.code], event.values, event.said)


def verdict_line(verdict: Verdict) -> str:
    """A verdict as cause, drive, value, limit and finding, for the same."""
    return _line(verdict.cause, verdict.drive, VERDICT_FIELDS[2:], verdict.values[2:], verdict.said)


def progress_line(progress: Progress | None) -> str:
    """What the machine does now, for the same; empty if there is nothing."""
    if progress is None:
        return ""
    fields = PROGRESS_FIELDS[progress.code]
    return _line(progress.code, progress.subject, fields, progress.values)


def _line(
    code: IntEnum, subject: str, names: Sequence[str], values: Sequence[float], said: str = ""
) -> str:
    named = [
        f"{name}={value}" if isinstance(value, str) else f"{name}={value:g}"
        for name, value in named_values(names, values).items()
    ]
    return " ".join(word for word in (name_of(code), subject, *named, said) if word)
