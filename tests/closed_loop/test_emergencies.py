"""EMCY messages in operation: what stops, what is only told, and what a flood of them costs."""

import pytest
from gaitd_names import (
    Cause,
    Doubt,
    EventCode,
    Mode,
    StopCategory,
)
from sessions import reported

from drives.canopen.bus import Frame

SYNC = 0x080
OVERLOADED = 0xFF01
"""EPOS4: a warning."""
HALL_SENSOR = 0x7388


def emcy(node_id, code, register=0x01):
    return Frame(0x080 + node_id, code.to_bytes(2, "little") + bytes((register, 1, 2, 3, 4, 5)))


def put(session, *frames):
    session.bus.seat.waiting.extend(frames)


def test_a_warning_is_recorded_and_does_not_stop(session):
    put(session, emcy(5, OVERLOADED))
    session.run(0.5)

    record = session.record
    (kept,) = [one for r in session.records for one in r.drives[0].emergencies]
    assert record.mode == Mode.GAIT
    assert record.drives[0].emergency_count == 1
    assert (kept.code, kept.alarm) == (OVERLOADED, False)
    assert kept.reaction == "nothing: a warning"


@pytest.mark.parametrize("code", [0x8611, 0x4242])
def test_every_other_code_stops_and_is_recorded_with_its_reaction(session, code):
    put(session, emcy(6, code))
    session.run_until(lambda record: not record.mode.active, within_s=0.1)
    session.run(0.02)

    (kept,) = [one for r in session.records for one in r.drives[1].emergencies]
    assert session.record.verdict.cause == Cause.EMERGENCY
    assert session.record.verdict.drive == "right/slide"
    assert (kept.code, kept.alarm, kept.error_register) == (code, True, 0x01)
    assert kept.vendor_bytes == "0102030405"
    assert kept.reaction


def test_an_encoder_that_cannot_be_believed_costs_the_reference_and_the_hold_of_its_axis(session):
    put(session, emcy(5, HALL_SENSOR))
    session.run(0.2)

    record = session.record
    assert [drive.referenced for drive in record.drives] == [False, True]
    assert record.verdict.category == StopCategory.S0
    assert record.verdict.cause == Cause.UNREFERENCED
    assert record.verdict.drive == "right/hip"
    (lost,) = reported(session.records, EventCode.REFERENCE_LOST)
    assert (lost.subject, lost.values) == ("right/hip", (Doubt.ENCODER_ERROR,))
    assert any(one.code == HALL_SENSOR for r in session.records for one in r.drives[0].emergencies)


def test_an_encoder_that_cannot_be_believed_at_rest_is_not_referenced_either(warm_ready):
    put(warm_ready, emcy(5, HALL_SENSOR), emcy(5, 0x0000, 0))
    warm_ready.run(0.2)

    assert [drive.referenced for drive in warm_ready.record.drives] == [False, True]


@pytest.mark.parametrize("codes", [(0x1000, 0x2310, 0x8611), (0x1000, 0x0000)])
def test_a_flood_of_emergencies_is_counted_exactly_and_answered_a_bounded_number_of_times(
    session, codes
):
    bus = session.bus
    before = len(bus.sent)

    for n in range(50):
        put(session, *(emcy(5, codes[(5 * n + k) % len(codes)]) for k in range(5)))
        session.loop.turn()

    sent = bus.sent[before:]
    syncs = sum(frame.can_id == SYNC for frame in sent)
    record = session.record
    expected = sum(codes[k % len(codes)] != 0 for k in range(250))
    assert record.drives[0].emergency_count == expected
    assert all(len(r.drives[0].emergencies) <= 2 for r in session.records)
    assert syncs == 50
    # SYNC, heartbeat and four commands in a cycle; each step of a stop is answered at once, too.
    assert len(sent) <= 50 * 6 + 4 * 4
    assert len(reported(session.records, EventCode.STOPPED)) == 1
