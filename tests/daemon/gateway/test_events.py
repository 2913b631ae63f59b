"""What changed from one record to the next, said once."""

import msgspec
import pytest
from gaitd_client import wire
from gaitd_names import Cause, EventCode, Finding, Mode, RequestKind, Stage, StopCategory, Trigger

from daemon.gateway.events import (
    DESCRIPTOR_BACK,
    NO_DESCRIPTOR,
    DescriptorEvents,
    Kind,
    Priority,
    new_events,
)
from daemon.ipc.record import EmergencyRecord, Verdict
from daemon.ipc.report import Event


def said(before, now):
    return [(item.kind, item.priority, item.code) for item in new_events(before, now)]


def test_kinds_and_priorities_are_those_that_the_schema_names():
    properties = wire.schema(wire.Event)["properties"]

    for name, known in (("kind", Kind), ("priority", Priority)):
        named, any_other = properties[name]["anyOf"]
        assert named["enum"] == [member.value for member in known]
        assert any_other == {"type": "string"}


def test_nothing_changed_is_no_event(make_record):
    assert said(make_record(1), make_record(2)) == []


@pytest.mark.parametrize(
    ("changes", "kind", "priority", "code", "values"),
    [
        (
            {"power_state": 8},
            Kind.DRIVE,
            Priority.MEDIUM,
            "power_state_changed",
            {"power_state": "fault"},
        ),
        (
            {"power_state": 6},
            Kind.DRIVE,
            Priority.INFO,
            "power_state_changed",
            {"power_state": "quick_stop_active"},
        ),
        (
            {"nmt_state": 0x7F},
            Kind.DRIVE,
            Priority.INFO,
            "nmt_state_changed",
            {"nmt_state": "pre_operational"},
        ),
        (
            {"emergency_code": 0x8130, "emergency_text": "heartbeat error", "emergency_count": 1},
            Kind.EMERGENCY,
            Priority.HIGH,
            "emcy_received",
            {"emcy_code": 0x8130},
        ),
        (
            {"hand_switch_closed": False},
            Kind.INPUT,
            Priority.MEDIUM,
            "hand_switch_opened",
            {},
        ),
        ({"sto_released": False}, Kind.INPUT, Priority.MEDIUM, "sto_activated", {}),
        (
            {"referenced": False},
            Kind.DRIVE,
            Priority.MEDIUM,
            "position_lost",
            {},
        ),
    ],
)
def test_a_change_of_a_drive_is_one_event(
    make_record, make_drive, changes, kind, priority, code, values
):
    before = make_record(1, drives=(make_drive(),))
    now = make_record(2, drives=(make_drive(**changes),))

    (event,) = new_events(before, now)

    assert (event.kind, event.priority, event.code, event.values, event.subject) == (
        kind,
        priority,
        code,
        values,
        "right/hip",
    )


def test_a_drive_that_has_not_spoken_has_no_inputs(make_record, make_drive):
    silent = make_drive(power_state=0, hand_switch_closed=False, sto_released=False)
    before = make_record(1, drives=(silent,))
    now = make_record(2, drives=(make_drive(),))

    assert [kind for kind, _, _ in said(before, now)] == [Kind.DRIVE]


def test_drives_that_are_gone_for_a_bring_up_are_told_once_when_they_are_back(
    make_record, make_drive
):
    """Lost reference and ended fault are what a record without drives looks like."""
    faulty = make_drive(emergency_code=0x8130, emergency_count=1)
    gone = make_drive(power_state=0, nmt_state=0xFF, referenced=False, emergency_code=0)
    records = [make_record(n, drives=(one,)) for n, one in enumerate([faulty, gone, make_drive()])]

    assert said(records[0], records[1]) == []
    assert [code for _, _, code in said(records[1], records[2])] == ["power_state_changed"]


def emergency(code, **changes):
    made = EmergencyRecord(
        code=code,
        error_register=0x11,
        vendor_bytes="0102030405",
        text="heartbeat",
        reaction="abort connection option code, 6007h",
        alarm=True,
        loses_reference=False,
        repeated=False,
    )
    return msgspec.structs.replace(made, **changes)


def of_emergencies(make_record, make_drive, *emergencies):
    """What is said of a record in which these came."""
    newest = make_drive(
        emergency_code=emergencies[-1].code,
        emergency_count=len(emergencies),
        emergencies=emergencies,
    )
    return new_events(make_record(1, drives=(make_drive(),)), make_record(2, drives=(newest,)))


def test_an_emergency_is_told_with_cause_reaction_register_and_the_vendor_s_bytes(
    make_record, make_drive
):
    (event,) = of_emergencies(make_record, make_drive, emergency(0x8130))

    assert (event.kind, event.priority, event.subject) == (
        Kind.EMERGENCY,
        Priority.HIGH,
        "right/hip",
    )
    assert event.values == {"emcy_code": 0x8130}
    assert event.said == "heartbeat; drive: abort connection option code, 6007h; 11h 0102030405"


def test_a_warning_is_a_low_priority(make_record, make_drive):
    told = of_emergencies(make_record, make_drive, emergency(0xFF01, alarm=False))

    assert [event.priority for event in told] == [Priority.LOW]


def test_every_emergency_of_a_cycle_is_told_and_one_that_repeats_itself_is_not(
    make_record, make_drive
):
    told = of_emergencies(
        make_record,
        make_drive,
        emergency(0x8130),
        emergency(0x8611),
        emergency(0x8130, repeated=True),
    )

    assert [event.values["emcy_code"] for event in told] == [0x8130, 0x8611]


def test_an_emergency_that_is_over_is_an_event(make_record, make_drive):
    before = make_record(1, drives=(make_drive(emergency_code=0x8130, emergency_count=1),))
    now = make_record(2, drives=(make_drive(emergency_count=2),))

    assert said(before, now) == [(Kind.EMERGENCY, Priority.INFO, "emcy_cleared")]


@pytest.mark.parametrize("cause", [cause for cause in Cause if cause is not Cause.NONE])
def test_every_cause_is_told_with_its_value_limit_and_drive(make_record, cause):
    verdict = Verdict(StopCategory.S1, cause, "right/hip", 2.5, 2.0)

    (stop,) = new_events(make_record(1), make_record(2, verdict=verdict))

    assert (stop.kind, stop.code, stop.cause, stop.subject) == (
        Kind.STOP,
        "stopped",
        cause,
        "right/hip",
    )
    assert stop.values == {
        "category": "S1",
        "cause": cause,
        "value": 2.5,
        "limit": 2.0,
        "finding": "none",
    }


def test_a_requested_stop_is_a_low_priority_and_a_limit_a_high_one(make_record):
    causes = (Cause.STOP_REQUESTED, Cause.HAND_SWITCH_OPEN, Cause.VELOCITY_LIMIT)
    verdicts = [Verdict(StopCategory.S1, cause) for cause in causes]

    priorities = [
        new_events(make_record(1), make_record(2, verdict=verdict))[0].priority
        for verdict in verdicts
    ]

    assert priorities == [Priority.LOW, Priority.MEDIUM, Priority.HIGH]


def of_cause(code, cause):
    return Event(code, "right/hip", (StopCategory.S1, cause, 0.0, 0.0, Finding.NONE))


def test_the_cores_own_event_of_the_same_stop_is_not_said_again(make_record):
    verdict = Verdict(StopCategory.S1, Cause.HAND_SWITCH_OPEN)
    changed = Event(EventCode.MODE_CHANGED, "", (Mode.HOLD, Mode.STOPPING, Trigger.STOP))
    events = (of_cause(EventCode.STOPPED, verdict.cause), changed)

    told = said(make_record(1), make_record(2, verdict=verdict, mode=Mode.STOPPING, events=events))

    assert [(kind, priority) for kind, priority, _ in told] == [
        (Kind.STOP, Priority.MEDIUM),
        (Kind.MODE, Priority.INFO),
    ]
    assert told[1][2] == "mode_changed"


def test_an_event_of_another_cause_than_that_of_the_stop_is_said(make_record):
    verdict = Verdict(StopCategory.S1, Cause.HAND_SWITCH_OPEN)
    other = of_cause(EventCode.FURTHER_CAUSE, Cause.STO_ACTIVE)

    told = said(make_record(1), make_record(2, verdict=verdict, events=(other,)))

    assert [code for _, _, code in told][-1] == "further_cause"


def test_a_mode_change_without_an_event_of_the_core_is_said_here(make_record):
    assert said(make_record(1), make_record(2, mode=Mode.FAULT)) == [
        (Kind.MODE, Priority.MEDIUM, "mode_changed")
    ]


def test_a_verdict_that_is_cleared_is_an_event(make_record):
    before = make_record(1, verdict=Verdict(StopCategory.S1, Cause.HAND_SWITCH_OPEN))

    assert said(before, make_record(2)) == [(Kind.STOP, Priority.INFO, "verdict_cleared")]


def test_events_of_the_core_are_sorted_by_what_they_are_about(make_record):
    enable, mode = RequestKind.ENABLE, RequestKind.MODE
    events = (
        Event(EventCode.REQUEST_RECEIVED, "", (enable, Mode.HOLD)),
        Event(EventCode.REQUEST_RECEIVED, "", (mode, Mode.GAIT)),
        Event(EventCode.STAGE_CHANGED, "right", (Mode.GAIT, Stage.APPROACHING, 0)),
    )

    told = said(make_record(1), make_record(2, events=events))

    assert [kind for kind, _, _ in told] == [Kind.REQUEST, Kind.REQUEST, Kind.NOTE]


def test_what_the_can_controller_says_of_itself_asks_for_attention(make_record):
    passive = Event(EventCode.CAN_PASSIVE)

    told = said(make_record(1), make_record(2, events=(passive,)))

    assert told == [(Kind.NOTE, Priority.LOW, "can_passive")]


def test_used_up_descriptors_are_reported_once_and_so_are_free_ones():
    events = DescriptorEvents()

    turns = [events.turn(has_one=has_one) for has_one in (True, False, False, True, True)]

    assert turns == [[], [NO_DESCRIPTOR], [], [DESCRIPTOR_BACK], []]
