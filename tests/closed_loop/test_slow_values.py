"""A temperature that is not measured any more is unknown, said so, and judged as the limit is."""

from pathlib import Path

import pytest
from sessions import changed_configs, new_session

from daemon.ipc.record import Cause, StopCategory

CHOSEN = 'temperature_limit = "S2"'


@pytest.mark.parametrize("category", ["S2", "S1"])
def test_without_tpdo3_the_temperature_becomes_unknown_and_stops_as_the_file_says(
    tmp_path: Path, category: str
):
    changed = CHOSEN.replace("S2", category)
    session = new_session(changed_configs(tmp_path, ("limits.toml", CHOSEN, changed))).enable()
    assert session.record.drives[0].temperature_degc is not None

    session.command("lost_tpdo right/hip - 3")
    session.run(0.2)
    assert session.record.verdict.cause == Cause.NONE
    session.run(0.25)

    record = session.record
    assert record.drives[0].temperature_degc is None
    assert record.drives[1].temperature_degc is not None
    assert record.verdict.cause == Cause.TEMPERATURE_LIMIT
    assert record.verdict.category == StopCategory[category]
    assert record.verdict.drive == "right/hip"
    events = [event for one in session.records for event in one.events]
    assert events.count("right/hip: its temperature is not measured any more") == 1

    session.command("clear lost_tpdo right/hip")
    session.run(0.2)
    assert session.record.drives[0].temperature_degc is not None
    assert session.record.verdict.cause == Cause.TEMPERATURE_LIMIT
