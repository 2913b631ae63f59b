"""The benchmarks measure what they say; no test here judges a time."""

import json
import math
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from gaitd_toml import load_toml
from rich.console import Console
from sessions import CONFIGS, new_session

from daemon.config.settings import Robot
from daemon.core import cycle
from gaitd.command_line import json_text
from gaitd_lab.benchmark import (
    bare_put,
    bare_timer,
    cycle_time,
    lateness,
    replay_speed,
    whole_service,
)
from gaitd_lab.benchmark.figures import Figure, table
from gaitd_lab.processes import ServiceError


@pytest.fixture(scope="module")
def session():
    return new_session().until_ready()


@pytest.fixture
def robot():
    return load_toml(CONFIGS / "robot.toml", Robot)


def test_every_cycle_is_timed_and_the_timer_is_taken_off_again(session):
    with cycle_time.stopwatch() as times_ns:
        begun = len(session.records)
        session.run(0.5)
        cycles = len(session.records) - begun

    assert cycles == pytest.approx(50, abs=1)
    assert len(times_ns) == cycles
    assert min(times_ns) > 0
    assert cycle.step.__name__ == "step"


def test_lateness_is_that_of_the_records(session):
    records = session.records[-20:]

    bare_ns = [50_000] * 998 + [4_000_000, 9_000_000]
    median, high, worst, judged, skipped, _ = lateness.of(records, bare_ns)

    late_us = [record.timing.lateness_ns / 1000 for record in records]
    assert worst.value == pytest.approx(max(late_us))
    assert median.value == pytest.approx(np.median(late_us))
    assert median.value <= high.value <= worst.value
    assert (judged.value, judged.peer) == (high.value, "")
    assert judged.at_most == high.peer_value + 250.0, "this machine delays a bare timer, too"
    assert lateness.of(records, [50_000] * 1000)[3].at_most == 500.0
    assert (median.peer_value, worst.peer_value) == (50.0, 9000.0)
    assert (skipped.value, skipped.unit, skipped.peer_value) == (0, "of 20", 2)


def test_a_bare_timer_tells_each_point_of_its_grid_once():
    late_ns = bare_timer.lateness_ns(2_000_000, 0.03)

    assert 1 <= len(late_ns) <= 16
    assert min(late_ns) >= 0


def test_the_speed_of_replay_is_measured_on_a_recording_that_is_valid(robot, monkeypatch):
    monkeypatch.setattr(replay_speed, "DURATION_S", 5.0)

    computing, with_csv, row = replay_speed.measure(robot)

    assert computing.value > with_csv.value > 0
    assert row.value == pytest.approx(1e6 / 100 / computing.value, rel=0.01)


# --- the table ------------------------------------------------------------------------------------

ALONE = Figure(what="work", value=500.0, unit="µs", at_most=400.0)
BESIDE = Figure(what="way", value=300.0, unit="µs", peer="bare", peer_value=200.0, at_most=2.0)


def test_a_figure_is_judged_by_its_ratio_where_there_is_a_peer():
    assert BESIDE.ratio == 1.5
    assert BESIDE.is_met
    assert not BESIDE._replace(peer_value=140.0).is_met
    assert not ALONE.is_met
    assert ALONE._replace(value=400.0).is_met
    assert not Figure(what="speed", value=9.0, unit="", at_least=10.0).is_met
    assert not BESIDE._replace(peer_value=math.nan).is_met


def test_every_number_is_beside_its_peer_and_its_budget():
    console = Console(width=120)
    with console.capture() as captured:
        console.print(table([ALONE, BESIDE]))

    for text in ("500 µs", "≤ 400 µs", "300 µs", "bare", "200 µs", "1.5", "≤ 2"):
        assert text in captured.get()


def test_results_become_json_with_their_names():
    told = json.loads(json_text({"cycle": [BESIDE]}))["cycle"][0]

    assert (told["what"], told["value"], told["peer_value"]) == ("way", 300.0, 200.0)


def test_bare_zenoh_is_timed_from_the_put_in_another_process_to_the_callback_in_this():
    assert whole_service.bare_puts(1400, 0.5) > 0


def test_a_payload_tells_when_it_was_put_and_is_as_long_as_asked():
    payload = bare_put.stamped(123_456_789_012_345, 1400)

    assert bare_put.stamp_of(payload) == 123_456_789_012_345
    assert len(payload) == 1400


def _delivered(records, beyond_ns, zenoh_ns):
    """A message of each record, that long after the frames were sent."""
    return [
        whole_service.ReceivedMessage(
            record.sync_mono_ns + record.timing.collect_ns + after.timing.work_ns + beyond_ns,
            json.dumps({"cycle": record.cycle}).encode(),
            zenoh_ns,
        )
        for record, after in pairwise(records)
    ]


def test_the_parts_of_a_delivery_are_all_of_it(session):
    records = [
        msgspec.structs.replace(
            record, timing=msgspec.structs.replace(record.timing, work_ns=700_000 + 1000 * number)
        )
        for number, record in enumerate(session.records[-20:])
    ]

    found = whole_service.divide(_delivered(records, 500_000, 200_000), records, 120.0)

    assert found.work_us == pytest.approx(710.0)
    assert found.beyond_us == pytest.approx(500.0)
    assert found.ipc_us == pytest.approx(180.0)
    assert found.zenoh_us == pytest.approx(200.0)
    parts_us = found.work_us + found.ipc_us + found.gateway_us
    assert found.whole_us == pytest.approx(parts_us + found.zenoh_us)


def test_messages_of_no_record_are_no_measurement(session):
    with pytest.raises(ServiceError, match="none of 0 messages"):
        whole_service.divide([], session.records[-20:], 120.0)
