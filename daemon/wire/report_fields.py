"""Names of the values of events, refusals and progress (`daemon/ipc/report.py`), in their order.

A name ends in its unit; or the value is a member of an enum of `gaitd_names`.
"""

from collections.abc import Mapping, Sequence
from typing import Final

from gaitd_names import (
    EventCode,
    ProgressCode,
    RefusalCode,
)

from daemon.ipc.report import Event

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
    EventCode.ERROR_CODE_SHOWN: ("emcy_code",),
    EventCode.TEMPERATURE_OVERDUE: (),
    EventCode.TEMPERATURE_BACK: (),
    EventCode.CLONUS_BEGUN: (),
    EventCode.CALIBRATION_ADVISED: ("friction_error_si", "correlation"),
    EventCode.OFFSET_FOUND: ("offset_si", "allowed_si"),
    EventCode.SLOPE_FOUND: ("slope_si", "allowed_si"),
    EventCode.BASELINE_BEGUN: (),
    EventCode.BASELINE_TAKEN: ("stride_count", "kept_hip_nm", "kept_slide_n"),
    EventCode.BASELINE_REFUSED: ("finding", "value", "limit"),
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
REFUSAL_FIELDS: Final[Mapping[str, tuple[str, ...]]] = {
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


def named_values(names: Sequence[str], values: Sequence[float | str]) -> dict[str, float | str]:
    """Values of a report by name.

    A core of another version may send more values, or fewer: those without a name are left out.
    """
    return dict(zip(names, values, strict=False))


def values_of(event: Event) -> dict[str, float | str]:
    """The values of an event by name; those of a refusal with its code."""
    names = EVENT_FIELDS[event.code]
    values = named_values(names, event.values)
    refused = values.get("refusal")
    if isinstance(refused, str):  # a code of another version has values without names
        of_refusal = REFUSAL_FIELDS.get(refused, ())
        values |= named_values(of_refusal, event.values[len(names) :])
    return values
