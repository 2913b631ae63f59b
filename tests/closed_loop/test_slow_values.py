"""A temperature that is not measured any more is unknown, said so, and judged as the limit is."""

from pathlib import Path

import pytest
from gaitd_names import Cause, EventCode, Mode, StopCategory
from sessions import generic_drives, new_session, reported
from wire import change_what_drives_say

CHOSEN = 'temperature_limit = "S2"'


def stopped_for_the_temperature(session, category):
    record = session.record
    assert record.drives[0].temperature_degc is None
    assert record.drives[1].temperature_degc is not None
    assert record.verdict.cause == Cause.TEMPERATURE_LIMIT
    assert record.verdict.category == StopCategory[category]
    assert record.verdict.drive == "right/hip"
    (overdue,) = reported(session.records, EventCode.TEMPERATURE_OVERDUE)
    assert overdue.subject == "right/hip"


def test_without_tpdo3_the_temperature_becomes_unknown_and_stops_as_the_file_says(tmp_path: Path):
    configs = generic_drives(tmp_path)
    limits = configs / "limits.toml"
    limits.write_text(limits.read_text().replace(CHOSEN, CHOSEN.replace("S2", "S1")))
    session = new_session(configs).enable()
    assert session.record.drives[0].temperature_degc is not None

    session.command("lost_tpdo right/hip - 3")
    session.run(0.2)
    assert session.record.verdict.cause == Cause.NONE
    session.run(0.25)

    stopped_for_the_temperature(session, "S1")

    session.command("clear lost_tpdo right/hip")
    session.run(0.2)
    assert session.record.drives[0].temperature_degc is not None
    assert session.record.verdict.cause == Cause.TEMPERATURE_LIMIT


def test_without_answers_by_sdo_the_temperature_becomes_unknown_and_stops(warm_hold):
    session = warm_hold
    session.run(1.0)
    assert session.record.drives[0].temperature_degc == pytest.approx(25.0)
    refusing = True

    def refuse(frame):
        return (
            frame._replace(data=b"\x80" + frame.data[1:])
            if refusing and frame.can_id == 0x585
            else frame
        )

    change_what_drives_say(session, refuse)
    session.run(1.0)
    assert session.record.mode == Mode.HOLD
    session.run(1.0)

    stopped_for_the_temperature(session, "S2")

    refusing = False
    session.run(1.0)
    assert session.record.drives[0].temperature_degc is not None
