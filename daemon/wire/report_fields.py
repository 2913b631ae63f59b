"""Names of the values of events and refusals (`daemon/ipc/report.py`), in their order.

A name ends in its unit, or is a key of `ENUMS`: then the value is the number of a member of that
enum.
"""

from collections.abc import Mapping
from enum import IntEnum
from typing import Final

from daemon.ipc.cycle_timing import CyclePart
from daemon.ipc.record import Cause, Mode, RequestKind, Role, Stage, StopCategory
from daemon.ipc.report import (
    Doubt,
    EventCode,
    Failure,
    Finding,
    RefusalCode,
    SelfTestDue,
    Trigger,
    Untested,
)
from daemon.wire.names import NmtState, PowerState

_CAUSE: Final = ("category", "cause", "value", "limit", "finding")
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
    EventCode.STOPPED: _CAUSE,
    EventCode.FURTHER_CAUSE: _CAUSE,
    EventCode.CAUSE_FOUND: _CAUSE,
    EventCode.STILL_LATCHED: (*_CAUSE, "latched_utc_s"),
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
VERDICTS: Final = frozenset(code for code, names in EVENT_FIELDS.items() if names[:5] == _CAUSE)
"""Events that report a verdict; their subject is its drive."""
_RANGE: Final = ("wanted", "lowest", "highest")
_ABOVE: Final = ("wanted", "highest")
REFUSAL_FIELDS: Final[Mapping[RefusalCode, tuple[str, ...]]] = {
    RefusalCode.NO_SUCH_MODE: ("mode",),
    RefusalCode.NOT_IN_THIS_MODE: ("trigger", "mode"),
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
    RefusalCode.STOPPED: _CAUSE,
    RefusalCode.ROLE_MAY_NOT: ("role", "request"),
    RefusalCode.ROLE_MAY_NOT_MODE: ("role", "mode"),
    RefusalCode.NO_PLAN: (),
    RefusalCode.CADENCE_ABOVE_PLAN: _ABOVE,
    RefusalCode.AMPLITUDE_ABOVE_PLAN: _ABOVE,
    RefusalCode.DURATION_ABOVE_PLAN: _ABOVE,
    RefusalCode.LEASE_NEEDED: (),
    RefusalCode.LEASE_HELD: (),
    RefusalCode.BUSY: ("request",),
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
ENUMS: Final[Mapping[str, type[IntEnum]]] = {
    "category": StopCategory,
    "cause": Cause,
    "doubt": Doubt,
    "failure": Failure,
    "finding": Finding,
    "mode": Mode,
    "mode_before": Mode,
    "nmt_state": NmtState,
    "part": CyclePart,
    "power_state": PowerState,
    "refusal": RefusalCode,
    "request": RequestKind,
    "role": Role,
    "self_test_due": SelfTestDue,
    "stage": Stage,
    "trigger": Trigger,
    "untested": Untested,
}
