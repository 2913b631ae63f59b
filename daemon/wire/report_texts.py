"""English sentences of events, refusals and verdicts, for the journal, events and replies.

A sentence is a template with the names of `report_fields.py`, with `said` and `subject`. A value of
an enum is put in as its text in `MEMBER_TEXT`, or as its name.
"""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from enum import IntEnum
from math import isfinite
from typing import Final

from daemon.ipc.record import Cause, StopCategory, Verdict
from daemon.ipc.report import (
    Doubt,
    Event,
    EventCode,
    Failure,
    Finding,
    Refusal,
    RefusalCode,
    SelfTestDue,
    Trigger,
    Untested,
)
from daemon.wire.cause_texts import CAUSE_TEXT
from daemon.wire.report_fields import ENUMS, EVENT_FIELDS, REFUSAL_FIELDS, VERDICTS

_WIRING: Final = "check termination, cable and bit rate"
_SELF_TEST: Final = (
    "friction {friction_si:.3g} {unit} ({friction_ratio:.2f} of the configured), "
    "load off by {load_error_si:.3g} {unit}"
)
_SIGN_TEST: Final = (
    "pushed forth with {effort_forth_si:+.3g} it moved {moved_forth_si:+.3g}, "
    "back with {effort_back_si:+.3g} it moved {moved_back_si:+.3g}"
)
EVENT_TEXT: Final[Mapping[EventCode, str]] = {
    EventCode.BRING_UP_BEGUN: "bring-up begun",
    EventCode.DRIVES_UP: "drives are up",
    EventCode.NOT_REFERENCED: "not referenced: {doubt}",
    EventCode.BRING_UP_FAILED: "bring-up failed: {said}",
    EventCode.DRIVE_HOLDS: "found powered, in {power_state}",
    EventCode.FOUND_WITH_ERROR: "found with error {emcy_code}: {said}",
    EventCode.EMCY_IN_BRING_UP: "EMCY {emcy_code} during bring-up: {said}",
    EventCode.BUS_LOAD: (
        "the bus will be busy at most {busy_ratio:.1%} of the time "
        "(allowed {busy_max_ratio:.0%}), the frames of one cycle take at most {burst_s:.2g} s"
    ),
    EventCode.MODE_CHANGED: "mode {mode_before} -> {mode}: {trigger}",
    EventCode.STAGE_CHANGED: "{mode} {stage}: {failure}",
    EventCode.STOPPED: "stop {category}: {verdict}",
    EventCode.FURTHER_CAUSE: "also: {verdict}",
    EventCode.CAUSE_FOUND: "{verdict}",
    EventCode.STILL_LATCHED: "latched since {latched}: {verdict}",
    EventCode.REQUEST_RECEIVED: "{request} requested {subject}",
    EventCode.REQUEST_REFUSED: "{request} refused: {refusal}",
    EventCode.REQUEST_DONE: "{request} done {subject}",
    EventCode.LEASE_DROPPED: (
        "lease dropped: its holder has the role {role}, which may not hold it; "
        "if the gateway is older than the core, restart the gateway"
    ),
    EventCode.RELOAD_REFUSED: (
        "reload requested: the core changes nothing while it runs. With the machine empty: "
        "systemctl restart gaitd-core"
    ),
    EventCode.REFERENCE_LOST: "not referenced any more: {doubt}",
    EventCode.TEMPERATURE_OVERDUE: "its temperature is not measured any more",
    EventCode.TEMPERATURE_BACK: "its temperature is measured again",
    EventCode.CLONUS_BEGUN: "clonus, guidance is softer while it lasts",
    EventCode.CALIBRATION_ADVISED: (
        "friction is {friction_error_si:+.3g} from its law "
        "(correlation {correlation:+.2f}): calibrate"
    ),
    EventCode.TESTS_FORGOTTEN: "its drive has no serial number: test it again",
    EventCode.CLOCK_SET_BACK: (
        "the clock went back by {back_s:.0f} s: what was tested today counts no more"
    ),
    EventCode.SELF_TEST_PASSED: f"self-test passed: {_SELF_TEST}",
    EventCode.SELF_TEST_FAILED: f"self-test {{finding}}: {_SELF_TEST}",
    EventCode.SIGN_TESTED: f"moves with its torque: {_SIGN_TEST}",
    EventCode.SIGN_PROVEN: f"its sign is proven, {_SIGN_TEST}",
    EventCode.HOMED: "homed",
    EventCode.SINGLE_AXIS_BEGUN: "{mode} begun",
    EventCode.SINGLE_AXIS_FAILED: "failed: {failure}",
    EventCode.CYCLES_MISSED: (
        "{missed_count:.0f} cycles in a row had no time and were left out: late by the {part}"
    ),
    EventCode.MEMORY_NOT_LOCKED: "mlockall refused ({said}): RLIMIT_MEMLOCK is {limit_bytes:.0f}",
    EventCode.PROCESSORS_REFUSED: "realtime_cpus refused: the processors given are {said}",
    EventCode.PRIORITY_REFUSED: (
        "SCHED_FIFO priority {priority:.0f} refused: RLIMIT_RTPRIO is {priority_max:.0f}"
    ),
    EventCode.STATES_REFUSED: "datagrams to the core refused, {refused_count:.0f} so far: {said}",
    EventCode.RECORDS_SHORTENED: (
        "records were written without their texts, which did not fit, {shortened_count:.0f} so far"
    ),
    EventCode.STATES_CROWDED: (
        "the core received more datagrams than it reads in a cycle, {crowded_count:.0f} so far"
    ),
    EventCode.CAN_ACTIVE: "CAN controller works without errors again",
    EventCode.CAN_WARNING: f"CAN controller sees many errors (warning): {_WIRING}",
    EventCode.CAN_PASSIVE: f"CAN controller is error passive: {_WIRING}",
    EventCode.CAN_OFF: (
        "CAN controller is bus-off, nothing is sent until it is restarted (restart-ms of the "
        f"interface, or set it down and up): {_WIRING}"
    ),
    EventCode.CAN_ALONE: (
        "CAN frames are not acknowledged: no other node is on the bus, or the bit rate differs"
    ),
    EventCode.CAN_FRAMES_LOST: (
        "CAN controller lost frames, {lost_count:.0f} times so far: the machine is too slow or "
        "the bus too full"
    ),
    EventCode.CAN_FOREIGN_MASTER: (
        "CAN frames of another master, {frame_count:.0f} so far: SYNC or our heartbeat"
    ),
}
_NAME_SUBJECT: Final = VERDICTS | {
    EventCode.REQUEST_RECEIVED,
    EventCode.REQUEST_REFUSED,
    EventCode.REQUEST_DONE,
}
"""Events whose sentence has its subject in it."""
_NEEDS_EMPTY: Final = "that is for the empty machine, and a patient is configured"
REFUSAL_TEXT: Final[Mapping[RefusalCode, str]] = {
    RefusalCode.NO_SUCH_MODE: "{mode} is not a mode that can be asked for",
    RefusalCode.NOT_IN_THIS_MODE: "'{trigger}' is not possible in mode {mode}",
    RefusalCode.NOT_HOLDING_YET: "the drives are not holding yet",
    RefusalCode.GUIDANCE_BY_POSITION: (
        "assist is refused: with guidance 'position' the drives give the torque"
    ),
    RefusalCode.SELF_TEST_DUE: "{self_test_due}",
    RefusalCode.GATEWAY_SILENT: "the gateway is not alive",
    RefusalCode.HAND_SWITCH_OPEN: "the hand switch is open",
    RefusalCode.HAND_SWITCH_UNKNOWN: "no drive shows the hand switch, which must be held for this",
    RefusalCode.STO_ACTIVE: "safe torque off is active",
    RefusalCode.SIGN_NOT_PROVEN: "the sign is not proven: {subject}",
    RefusalCode.NOT_REFERENCED: "not referenced: {subject} ({doubt})",
    RefusalCode.INPUT_UNTESTED: "not seen to act today: {subject} {untested}",
    RefusalCode.NO_SAMPLE: "no sample of this cycle: {subject}: ask again",
    RefusalCode.LEG_MOVES: "the leg is moving",
    RefusalCode.OUTSIDE_RANGE: "outside its range: {subject}",
    RefusalCode.PATIENT_CONFIGURED: _NEEDS_EMPTY,
    RefusalCode.NO_CLEAR_WAY: "{subject}: there is no clear way from here to mid pose",
    RefusalCode.NO_ROOM: ("{subject} has no room to move a little: take the leg to another pose"),
    RefusalCode.STOPPED: "{verdict}",
    RefusalCode.ROLE_MAY_NOT: "the role {role} may not request {request}",
    RefusalCode.ROLE_MAY_NOT_MODE: "the role {role} may not request mode {mode}",
    RefusalCode.NO_PLAN: "no plan is released",
    RefusalCode.CADENCE_ABOVE_PLAN: (
        "cadence_hz = {wanted:g}, the released plan allows up to {highest:g}"
    ),
    RefusalCode.AMPLITUDE_ABOVE_PLAN: (
        "amplitude_ratio = {wanted:g}, the released plan allows up to {highest:g}"
    ),
    RefusalCode.DURATION_ABOVE_PLAN: (
        "duration_s = {wanted:g}, the released plan allows up to {highest:g}"
    ),
    RefusalCode.LEASE_NEEDED: "mode torque needs a lease, and no client holds one",
    RefusalCode.LEASE_HELD: (
        "an artificial disturbance would mislead the controller that holds the lease"
    ),
    RefusalCode.BUSY: "another request is outstanding: {request}",
    RefusalCode.OLD: "made for cycle {for_cycle:.0f}, it is {cycle:.0f} now",
    RefusalCode.STOP_REQUESTED: "a stop was requested at the same time",
    RefusalCode.CADENCE_OUT_OF_RANGE: (
        "cadence_hz = {wanted:g}, allowed {lowest:g} to {highest:g}"
    ),
    RefusalCode.AMPLITUDE_OUT_OF_RANGE: "amplitude_ratio = {wanted:g}, allowed > 0 and <= 1",
    RefusalCode.DURATION_OUT_OF_RANGE: "duration_s = {wanted:g}, allowed > 0 and <= {highest:g}",
    RefusalCode.NO_SUCH_SCENARIO: "there is no such scenario, configured are: {said}",
    RefusalCode.NO_SUCH_AXIS: "there is no such axis, known are: {said}",
    RefusalCode.NOT_TESTED: "{subject} has not been tested since the service's start",
    RefusalCode.NO_HOMING: "{subject} has no [homing] in its axis file",
    RefusalCode.FAILED: "{failure}",
}
MEMBER_TEXT: Final[Mapping[type[IntEnum], Mapping[IntEnum, str]]] = {
    Trigger: {
        Trigger.BRING_UP_BEGUN: "bring-up begun",
        Trigger.BRING_UP_DONE: "bring-up done",
        Trigger.STILL_LATCHED: "latched before this start",
        Trigger.DRIVES_LOST: "drives lost",
        Trigger.DRIVE_FAULTY: "drive faulty",
        Trigger.TO_HOLD: "mode hold",
        Trigger.TO_GAIT: "mode gait",
        Trigger.TO_TORQUE: "mode torque",
        Trigger.TO_EXCITE: "mode excite",
        Trigger.TO_HAND_GUIDING: "mode hand_guiding",
        Trigger.TO_SELF_TEST: "mode self_test",
        Trigger.TO_REFERENCE: "mode reference",
        Trigger.TO_COMMISSION: "mode commission",
        Trigger.BRING_UP_RESTARTED: "other limits for the drives",
        Trigger.EXERCISE_OVER: "exercise over",
        Trigger.LEASE_LAPSED: "assist lapsed",
        Trigger.AT_REST_WELL: "at rest, as asked",
        Trigger.AT_REST_STOPPED: "at rest, by a verdict",
    },
    Doubt: {
        Doubt.NOT_HOMED: "home it",
        Doubt.REBOOTED: "its drive has rebooted",
        Doubt.ENCODER_ERROR: "its encoder is in error",
        Doubt.ENCODER_JUMPED: "its encoder jumped",
        Doubt.NO_POSE_STORED: "no pose has been stored yet",
        Doubt.POSE_UNREADABLE: "the stored pose cannot be read",
        Doubt.LEFT_ELSEWHERE: "its encoder does not agree with the stored pose",
    },
    StopCategory: {one: one.name for one in StopCategory},
    Failure: {
        Failure.NONE: "",
        Failure.NO_REST: "not begun: no rest, which the change to torque mode needs",
        Failure.NOT_READY: "the drives and the leg were not ready in time: ask again",
        Failure.STOP_REQUESTED: "a stop was requested",
        Failure.DISABLE_REQUESTED: "disabling was requested",
        Failure.HOMING_ERROR: "the drive reports a homing error",
        Failure.HOME_NOT_FOUND: "home was not found in time",
        Failure.DOES_NOT_HOME: "the drive does not home",
        Failure.MOVES_AGAINST_TORQUE: (
            "it moves against its torque: motor or encoder is the wrong way round"
        ),
        Failure.DOES_NOT_MOVE: "the torque does not move it: is it blocked, or at its end stop?",
        Failure.KEEPS_MOVING: "the axis does not come to rest",
    },
    Untested: {
        Untested.HAND_SWITCH_OPEN: "hand switch open",
        Untested.HAND_SWITCH_CLOSED: "hand switch closed",
        Untested.STO_ACTIVE: "emergency stop (STO) pressed",
        Untested.STO_RELEASED: "emergency stop (STO) released",
    },
    SelfTestDue: {
        SelfTestDue.NOT_PASSED_TODAY: "no self-test has been passed today",
        SelfTestDue.FAILED: "the last self-test was not passed",
        SelfTestDue.OTHER_ROBOT_FILE: "the last self-test was of another robot file",
        SelfTestDue.TOO_OLD: "the last self-test is too old",
        SelfTestDue.OTHER_AXES: "the last self-test was of other axes",
        SelfTestDue.OTHER_DRIVE: "the last self-test was of another drive",
    },
    Finding: {
        Finding.NONE: "",
        Finding.CYCLES: "cycles",
        Finding.MISSED_CYCLES: "grid points missed in a row",
        Finding.CYCLES_WITHOUT_SAMPLE: "cycles without a complete sample",
        Finding.CYCLES_NOT_ALL_SENT: "cycles in a row whose frames were not all sent",
        Finding.CYCLES_WITHOUT_ESTIMATE: "cycles without a usable estimate",
        Finding.HEARTBEAT_AGE_MS: "ms since its last heartbeat",
        Finding.TEMPERATURE_DEGC: "degC",
        Finding.STRIDE_ENERGY_J: "J in a stride",
        Finding.MODE_DISPLAY: "mode of operation display",
        Finding.NMT_STATE: "NMT state {nmt_state}",
        Finding.POWER_STATE: "{power_state}",
        Finding.EMCY: "{emcy_code}",
        Finding.ANGLE_OF_SHOE: "|sin| between shank and shoe",
        Finding.ANGLE_ON_WAY_TO_REST: "|sin| between shank and shoe on the way to rest",
        Finding.NO_EMCY: "no EMCY seen",
        Finding.BOOT_UP_MESSAGE: "boot-up message in operation",
        Finding.NOT_FOLLOWING_BIT: "statusword bit 12",
        Finding.HELD_AWAY: "held away from its target",
        Finding.IMPOSSIBLE_BITS: "bits of 60FDh that are always 0",
        Finding.NEGATIVE_SWITCH: "towards the drive's negative limit switch",
        Finding.POSITIVE_SWITCH: "towards the drive's positive limit switch",
        Finding.CONTROLLER_OFF: "the controller reports bus-off",
        Finding.POSITION_NOT_FINITE: "its position is no number",
        Finding.EFFORT_NOT_FINITE: "its effort is no number",
        Finding.EFFORT_IMPOSSIBLE: "no drive gives that",
        Finding.STEP_BETWEEN_SAMPLES: "between two samples",
        Finding.SPEED_LOST: "speed lost at once",
        Finding.EFFORT_WITHOUT_MOTION: "effort changed, and the joint stood still",
        Finding.EFFORT_WITHOUT_POWER: "measured without power",
        Finding.EFFORT_NOT_AS_SENT: "measured from sent",
        Finding.EFFORT_UNCHANGED: "cycles of motion with the same effort",
        Finding.EFFORT_AGAINST_MOTION: "effort one way, motion the other",
        Finding.PUSHED_BACK: "the leg moves, its drive pushes back",
        Finding.MEAN_OF_STRIDE: "mean of a stride from what motion and load ask for",
        Finding.RISE_AGAINST_MOTION: "rise against the motion",
        Finding.SWINGS: "swings to and fro",
        Finding.NOT_MEASURED: "not measured any more",
        Finding.BELOW: "below",
        Finding.ABOVE: "above",
        Finding.RESTS_BELOW: "comes to rest below",
        Finding.RESTS_ABOVE: "comes to rest above",
        Finding.NOT_MOVED_FORTH: "sign: it did not move forth as it was guided",
        Finding.NOT_MOVED_BACK: "sign: it did not move back as it was guided",
        Finding.ACTS_AGAINST_MOTION: "sign: its effort acts against its motion",
        Finding.LOAD_OF_ANOTHER_LEG: "static load: not that of the leg",
        Finding.FRICTION_LESS: "friction: less than it was",
        Finding.FRICTION_MORE: "friction: more than it was",
        Finding.NO_SAMPLE: "no sample came while it moved",
        Finding.NOT_BEGUN: "not begun: no rest, which the change to torque mode needs",
        Finding.ENDED_WHILE_ENABLED: "it ended while drives were enabled",
        Finding.NOTES_UNREADABLE: "the notes of that run cannot be read",
        Finding.NOTES_TORN: "power failed while its last notes were written: older ones",
        Finding.NOTES_OF_OTHER_VERSION: "the cause is of another version",
        Finding.NOT_HELD: "after holding, at {value:.3g} per s",
        Finding.NOT_STOPPED: "after a quick stop, at {value:.3g} per s",
        Finding.NOT_DISABLED: "after disabling, at {value:.3g} per s",
        Finding.NOT_STOPPED_BY_NMT: "after NMT stop, at {value:.3g} per s",
    },
    Cause: {cause: text.title for cause, text in CAUSE_TEXT.items()},
}
"""Texts of members by their enum; a member without one is written by its name."""
_VALUE_OF_FINDING: Final = {
    Finding.NMT_STATE: "nmt_state",
    Finding.POWER_STATE: "power_state",
    Finding.EMCY: "emcy_code",
}
"""Name of the value of a verdict in the text of its finding, if not `value`."""
_FINITE: Final = frozenset({"emcy_code", "latched_utc_s"})


def event_text(event: Event) -> str:
    """The sentence of an event, with its subject before it; code and numbers if they are new."""
    names = EVENT_FIELDS[event.code]
    values = event.values[: len(names)]
    about = f"{event.subject}: " if event.subject and event.code not in _NAME_SUBJECT else ""
    if not _are_known(names, values):
        return f"{about}{event.code.name.lower()} {event.values} {event.said}".strip()
    fields = _fields(names, values) | {"said": event.said, "subject": event.subject}
    fields["unit"] = "N·m" if event.subject.endswith("hip") else "N"
    if event.code in VERDICTS:
        verdict = verdict_of(event)
        fields["verdict"] = describe(verdict)
        fields["latched"] = _utc(event.values[-1])
    if event.code is EventCode.REQUEST_REFUSED:
        fields["refusal"] = refusal_text(refusal_of(event))
    if fields.get("request") == "mode":
        fields["request"] = f"mode {fields['mode']}"
    return f"{about}{EVENT_TEXT[event.code].format_map(fields)}".strip(" :")


def refusal_of(event: Event) -> Refusal:
    """The refusal that an event REQUEST_REFUSED has reported."""
    _, _, code, *values = event.values
    return Refusal(RefusalCode(round(code)), event.subject, tuple(values), event.said)


def verdict_of(report: Event | Refusal) -> Verdict:
    """The verdict that an event of `VERDICTS` or a refusal STOPPED has reported."""
    category, cause, value, limit, finding = report.values[:5]
    return Verdict(
        StopCategory(round(category)),
        Cause(round(cause)),
        report.subject,
        value,
        limit,
        Finding(round(finding)),
        report.said,
    )


def refusal_text(refusal: Refusal) -> str:
    """The sentence of a refusal; code and numbers if they are new."""
    names = REFUSAL_FIELDS[refusal.code]
    if not _are_known(names, refusal.values):
        return f"{refusal.code.name.lower()} {refusal.values} {refusal.said}".strip()
    fields = _fields(names, refusal.values)
    fields |= {"subject": refusal.subject, "said": refusal.said}
    if refusal.code is RefusalCode.STOPPED:
        fields["verdict"] = describe(verdict_of(refusal))
    return REFUSAL_TEXT[refusal.code].format_map(fields).strip()


def describe(verdict: Verdict) -> str:
    """The sentence of a verdict: drive, cause, value and limit."""
    where = f"{verdict.drive}: " if verdict.drive else ""
    title = CAUSE_TEXT[verdict.cause].title
    numbers = f" ({verdict.value:.4g}, limit {verdict.limit:.4g})" if verdict.limit else ""
    detail = detail_text(verdict)
    return f"{where}{title}{numbers}" + (f": {detail}" if detail else "")


def detail_text(verdict: Verdict) -> str:
    """What a verdict was found by, and what the drive has said; empty if nothing."""
    name = _VALUE_OF_FINDING.get(verdict.finding, "value")
    found = str(verdict.value)
    if _are_known((name,), (verdict.value,)):
        found = MEMBER_TEXT[Finding][verdict.finding].format_map(_fields((name,), (verdict.value,)))
    return " ".join(part for part in (found, verdict.said) if part)


def _are_known(names: Sequence[str], values: Sequence[float]) -> bool:
    """False if a core of another version has other values, or an enum other members."""
    return len(names) == len(values) and all(
        value in list(ENUMS[name]) if name in ENUMS else name not in _FINITE or isfinite(value)
        for name, value in zip(names, values, strict=True)
    )


def _fields(names: Sequence[str], values: Sequence[float]) -> dict[str, float | str]:
    return {name: _shown(name, value) for name, value in zip(names, values, strict=True)}


def _shown(name: str, value: float) -> float | str:
    if name == "emcy_code":
        return f"{round(value):04X}h"
    return _member_text(ENUMS[name], value) if name in ENUMS else value


def _member_text(kind: type[IntEnum], value: float) -> str:
    member = kind(round(value))
    texts = MEMBER_TEXT.get(kind, {})
    return texts.get(member, member.name.lower())


def _utc(utc_s: float) -> str:
    if utc_s == 0.0:
        return "before this start"
    return f"{datetime.fromtimestamp(utc_s, UTC):%Y-%m-%d %H:%M:%S} UTC"
