"""English sentences of what the core reports: each code has one, and it is made of its values."""

from string import Formatter

import pytest

from daemon.ipc.record import Cause, Mode, RequestKind, Role, Stage, StopCategory, Verdict
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
from daemon.wire.report_texts import (
    EVENT_TEXT,
    MEMBER_TEXT,
    REFUSAL_TEXT,
    describe,
    detail_text,
    event_text,
    refusal_of,
    refusal_text,
    verdict_of,
)
from drives.signals import NmtState, PowerState

ADDED = {"said", "unit", "verdict", "latched", "refusal", "subject"}
"""Fields of a sentence beside the values of its code."""
TOLD_OTHERWISE = VERDICTS | {EventCode.REQUEST_REFUSED}
"""Events whose sentence has one of a verdict or a refusal in it, with its values."""
WORDLESS = {"mode", "mode_before", "stage", "request", "role", "part", "power_state", "nmt_state"}
"""Values whose members are written by their names."""
JUMPED = Verdict(StopCategory.S0, Cause.ENCODER_JUMP, "right/hip", 0.06, 0.045)
NAN = float("nan")


def fields_of(template):
    return {name for _, name, _, _ in Formatter().parse(template) if name is not None}


def values_of(names):
    """Other values for each name: the last member of an enum, else a number."""
    return tuple(
        float(list(ENUMS[name])[-1]) if name in ENUMS else 10.0 + index
        for index, name in enumerate(names)
    )


def of_verdict(code, verdict, *values):
    numbers = verdict.category, verdict.cause, verdict.value, verdict.limit, verdict.finding
    return Event(code, verdict.drive, (*numbers, *values), verdict.said)


@pytest.mark.parametrize("code", [code for code in EventCode if code not in TOLD_OTHERWISE])
def test_the_sentence_of_an_event_shows_the_values_of_its_code_and_no_others(code):
    shown = fields_of(EVENT_TEXT[code])

    unshown = set(EVENT_FIELDS[code]) - shown
    assert shown - ADDED <= set(EVENT_FIELDS[code])
    assert unshown <= {"cause", "mode", "moved_si", "value", "limit", "finding"}
    assert event_text(Event(code, "right/hip", values_of(EVENT_FIELDS[code]), "the drive's text"))


@pytest.mark.parametrize("code", [one for one in RefusalCode if one is not RefusalCode.STOPPED])
def test_the_sentence_of_a_refusal_shows_the_values_of_its_code_and_no_others(code):
    shown = fields_of(REFUSAL_TEXT[code])

    assert shown - ADDED <= set(REFUSAL_FIELDS[code])
    assert set(REFUSAL_FIELDS[code]) - shown <= {"lowest", "highest"}
    assert refusal_text(Refusal(code, "right/hip", values_of(REFUSAL_FIELDS[code]), "a, b"))


@pytest.mark.parametrize("catalogue", [EVENT_TEXT, REFUSAL_TEXT, *MEMBER_TEXT.values()])
def test_no_sentence_is_told_twice(catalogue):
    texts = [text for text in catalogue.values() if text]

    assert len(set(texts)) == len(texts)


@pytest.mark.parametrize(
    "kind", [Doubt, Failure, Finding, SelfTestDue, Untested, Cause, StopCategory]
)
def test_every_member_has_a_text(kind):
    texts = MEMBER_TEXT[kind]

    assert set(kind) - {kind(0)} <= set(texts) if 0 in list(kind) else set(kind) == set(texts)
    assert all(text for member, text in texts.items() if member)


def test_every_code_and_every_enum_is_in_a_catalogue():
    named = {name for names in EVENT_FIELDS.values() for name in names}
    named |= {name for names in REFUSAL_FIELDS.values() for name in names}

    assert set(EVENT_TEXT) == set(EVENT_FIELDS) == set(EventCode)
    assert set(REFUSAL_TEXT) == set(REFUSAL_FIELDS) == set(RefusalCode)
    assert named >= set(ENUMS) - {"nmt_state"}
    for name in set(ENUMS) - WORDLESS - {"refusal", "trigger"}:
        assert ENUMS[name] in MEMBER_TEXT
    for name in named - set(ENUMS):
        assert name.endswith(("_si", "_s", "_ratio", "_count", "_bytes", "_code")) or name in {
            *("value", "limit", "wanted", "lowest", "highest", "correlation"),
            *("priority", "priority_max", "for_cycle", "cycle"),
        }


@pytest.mark.parametrize(
    ("event", "text"),
    [
        (Event(EventCode.DRIVES_UP), "drives are up"),
        (
            Event(EventCode.NOT_REFERENCED, "right/hip", (Doubt.NOT_HOMED,)),
            "right/hip: not referenced: home it",
        ),
        (
            Event(EventCode.EMCY_IN_BRING_UP, "right/hip", (0x8130,), "heartbeat error"),
            "right/hip: EMCY 8130h during bring-up: heartbeat error",
        ),
        (
            Event(EventCode.DRIVE_HOLDS, "right/hip", (PowerState.OPERATION_ENABLED,)),
            "right/hip: found powered, in operation_enabled",
        ),
        (
            Event(EventCode.MODE_CHANGED, "", (Mode.HOLD, Mode.GAIT, Trigger.TO_GAIT)),
            "mode hold -> gait: mode gait",
        ),
        (of_verdict(EventCode.STOPPED, JUMPED), f"stop S0: {describe(JUMPED)}"),
        (of_verdict(EventCode.FURTHER_CAUSE, JUMPED), f"also: {describe(JUMPED)}"),
        (of_verdict(EventCode.CAUSE_FOUND, JUMPED), describe(JUMPED)),
        (
            of_verdict(EventCode.STILL_LATCHED, JUMPED, 1_700_000_000.0),
            f"latched since 2023-11-14 22:13:20 UTC: {describe(JUMPED)}",
        ),
        (
            of_verdict(EventCode.STILL_LATCHED, JUMPED, 0.0),
            f"latched since before this start: {describe(JUMPED)}",
        ),
        (
            Event(EventCode.REQUEST_RECEIVED, "", (RequestKind.ENABLE, Mode.HOLD)),
            "enable requested",
        ),
        (
            Event(EventCode.REQUEST_RECEIVED, "right/hip", (RequestKind.MODE, Mode.REFERENCE)),
            "mode reference requested right/hip",
        ),
        (
            Event(
                EventCode.REQUEST_REFUSED,
                "right/hip",
                (RequestKind.ENABLE, Mode.HOLD, RefusalCode.NOT_REFERENCED, Doubt.REBOOTED),
            ),
            "enable refused: not referenced: right/hip (its drive has rebooted)",
        ),
        (
            Event(EventCode.STAGE_CHANGED, "right", (Mode.GAIT, Stage.APPROACHING, Failure.NONE)),
            "right: gait approaching",
        ),
        (
            Event(EventCode.STAGE_CHANGED, "right", (Mode.EXCITE, Stage.OVER, Failure.NO_REST)),
            "right: excite over: not begun: no rest, which the change to torque mode needs",
        ),
        (
            Event(EventCode.SELF_TEST_PASSED, "right/slide", (40, 1.1, -3, 0.1, 0, 0, 0)),
            "right/slide: self-test passed: friction 40 N (1.10 of the configured), "
            "load off by -3 N",
        ),
        (
            Event(
                EventCode.SELF_TEST_FAILED,
                "right/hip",
                (9, 3.2, 0.5, 0.1, Finding.FRICTION_MORE, 3.2, 2.0),
            ),
            "right/hip: self-test friction: more than it was: friction 9 N·m "
            "(3.20 of the configured), load off by 0.5 N·m",
        ),
        (
            Event(EventCode.CALIBRATION_ADVISED, "right/hip", (0.5, -1.0)),
            "right/hip: friction is +0.5 from its law (correlation -1.00): calibrate",
        ),
        (
            Event(EventCode.STATES_REFUSED, values=(3,), said="not a map"),
            "datagrams to the core refused, 3 so far: not a map",
        ),
    ],
)
def test_an_event_reads_like_this(event, text):
    assert event_text(event) == text


@pytest.mark.parametrize(
    ("refusal", "text"),
    [
        (
            Refusal(RefusalCode.NOT_IN_THIS_MODE, values=(Trigger.ENABLE, Mode.FAULT)),
            "'enable' is not possible in mode fault",
        ),
        (
            Refusal(RefusalCode.SELF_TEST_DUE, values=(SelfTestDue.TOO_OLD,)),
            "the last self-test is too old",
        ),
        (
            Refusal(RefusalCode.SIGN_NOT_PROVEN, "right/hip"),
            "the sign is not proven: right/hip",
        ),
        (
            Refusal(RefusalCode.INPUT_UNTESTED, "right/hip", (Untested.HAND_SWITCH_OPEN,)),
            "not seen to act today: right/hip hand switch open",
        ),
        (
            Refusal(RefusalCode.ROLE_MAY_NOT, values=(Role.DISPLAY, RequestKind.ENABLE)),
            "the role display may not request enable",
        ),
        (
            Refusal(RefusalCode.CADENCE_OUT_OF_RANGE, values=(NAN, 0.02, 0.5)),
            "cadence_hz = nan, allowed 0.02 to 0.5",
        ),
        (
            Refusal(RefusalCode.NO_SUCH_SCENARIO, said="friction, paper"),
            "there is no such scenario, configured are: friction, paper",
        ),
        (
            Refusal(RefusalCode.STOPPED, "", Verdict(cause=Cause.STOP_REQUESTED).values),
            CAUSE_TEXT[Cause.STOP_REQUESTED].title,
        ),
        (
            Refusal(RefusalCode.FAILED, "", (Failure.KEEPS_MOVING,)),
            "the axis does not come to rest",
        ),
    ],
)
def test_a_refusal_reads_like_this(refusal, text):
    assert refusal_text(refusal) == text


@pytest.mark.parametrize(
    ("value", "finding", "said", "text"),
    [
        (0.0, Finding.NONE, "", ""),
        (0.0, Finding.NONE, "can0 is down", "can0 is down"),
        (0x0100, Finding.EMCY, "something", "0100h something"),
        (PowerState.SWITCHED_ON, Finding.POWER_STATE, "", "switched_on"),
        (NmtState.PRE_OPERATIONAL, Finding.NMT_STATE, "", "NMT state pre_operational"),
        (1.2345, Finding.NOT_HELD, "", "after holding, at 1.23 per s"),
        (0.0, Finding.NOTES_OF_OTHER_VERSION, "MELTED", "the cause is of another version MELTED"),
        (77.0, Finding.POWER_STATE, "", "77.0"),
        (NAN, Finding.EMCY, "", "nan"),
    ],
)
def test_the_detail_of_a_verdict_reads_like_this(value, finding, said, text):
    verdict = Verdict(StopCategory.S1, Cause.DRIVE_FAULT, "right/hip", value, 0.0, finding, said)

    assert detail_text(verdict) == text
    assert detail_text(verdict) in describe(verdict)


def test_a_verdict_is_described_with_drive_value_limit_and_detail():
    found = Verdict(
        StopCategory.S1, Cause.SPASM, "right/hip", 33.333, 20.0, Finding.RISE_AGAINST_MOTION
    )

    title = CAUSE_TEXT[Cause.SPASM].title
    said = "rise against the motion"
    assert describe(found) == f"right/hip: {title} (33.33, limit 20): {said}"


def test_an_event_gives_back_its_verdict_and_its_refusal():
    refused = Refusal(RefusalCode.OLD, "right/hip", (5, 9), "text")
    values = RequestKind.MODE, Mode.GAIT, refused.code, *refused.values

    event = Event(EventCode.REQUEST_REFUSED, refused.subject, values, refused.said)

    assert verdict_of(of_verdict(EventCode.STOPPED, JUMPED)) == JUMPED
    assert refusal_of(event) == refused


@pytest.mark.parametrize("values", [(), (99.0, 1.0, 1.0), (NAN, 1.0, 1.0), (1.0, 1.0)])
def test_a_code_with_values_of_another_version_is_told_with_its_numbers(values):
    told = event_text(Event(EventCode.MODE_CHANGED, "right", values))

    assert told == f"right: mode_changed {values}"
    assert refusal_text(Refusal(RefusalCode.OUTSIDE_RANGE, "right", (1.0,))) == (
        "outside_range (1.0,)"
    )
