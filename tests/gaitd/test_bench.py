"""The benchmarks measure what they say; no test here judges a time."""

import json
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from rich.console import Console
from sessions import CONFIGS, new_session

from daemon.config.settings import Robot
from daemon.config.strict import load_toml
from daemon.core import cycle
from gaitd.command_line import json_text
from gaitd_lab.benchmark import (
    bare_put,
    cycle_parts,
    lateness,
    replay_speed,
    scaling,
    step_times,
    tables,
    whole_service,
)
from gaitd_lab.benchmark.cycle_parts import PARTS, WHOLE
from gaitd_lab.processes import ServiceError


@pytest.fixture(scope="module")
def session():
    return new_session().until_ready()


@pytest.fixture
def robot():
    return load_toml(CONFIGS / "robot.toml", Robot)


def test_every_part_of_the_cycle_is_timed_in_every_cycle_and_put_back(session):
    before = [vars(owner)[attribute] for _, owner, attribute in PARTS]

    with cycle_parts.stopwatch() as times:
        begun = len(session.records)
        session.run(0.5)
        cycles = len(session.records) - begun

    assert cycles == pytest.approx(50, abs=1)
    assert len(times[WHOLE]) == cycles
    assert all(len(values) >= cycles - 1 for values in times.values())
    assert [vars(owner)[attribute] for _, owner, attribute in PARTS] == before
    assert cycle.step.__name__ == "step"


def test_the_parts_together_are_no_more_than_the_whole(session):
    with cycle_parts.stopwatch() as times:
        session.run(0.5)

    whole = sum(times[WHOLE])
    parts = sum(sum(values) for name, values in times.items() if name != WHOLE)
    assert 0 < parts < 1.2 * whole


def test_lateness_is_that_of_the_records(session):
    records = session.records[-20:]

    found = lateness.of(records)

    assert found.sync_count == 20
    assert sum(found.class_count) == 20
    wanted = np.max([record.timing.lateness_ns for record in records]) / 1000
    assert found.worst_us == pytest.approx(wanted)


def test_the_speed_of_replay_is_measured_on_a_recording_that_is_valid(robot, monkeypatch):
    monkeypatch.setattr(replay_speed, "DURATION_S", 5.0)

    found = replay_speed.measure(robot)

    assert found.row_count == 500
    assert found.computing_ratio > found.with_csv_ratio > 0


def test_results_become_json_with_their_names():
    part = cycle_parts.Part("observer", 1.0, 2.0, 0.5)

    text = json_text((part, part))

    assert json.loads(text)[0] == {
        "name": "observer",
        "median_us": 1.0,
        "high_us": 2.0,
        "share_ratio": 0.5,
    }


def test_every_number_stands_beside_its_budget():
    part = cycle_parts.Part(WHOLE, 500.0, 700.0, 1.0)

    table = tables.cycle("a cycle", (part,))

    console = Console(width=120)
    with console.capture() as captured:
        console.print(table)
    assert "≤ 400, ≤ 800 µs" in captured.get()
    assert "500 µs" in captured.get()


@pytest.fixture
def few(monkeypatch):
    monkeypatch.setattr(scaling, "ROWS", 1500)
    monkeypatch.setattr(scaling, "STEPS", 20)
    monkeypatch.setattr(step_times, "REPEATS", 1)


def test_growth_is_measured_for_every_number_of_legs_against_one(robot, few):
    found = scaling.measure(robot)

    assert [row.together_count for row in found.growth] == [1, 2, 4, 8]
    assert found.growth[0].recording_ratio == found.growth[0].leg_ratio == 1.0
    for row in found.growth:
        assert row.leg_ratio == pytest.approx(row.leg_us / found.growth[0].leg_us)
    assert "replayed row 496 bytes" in str(tables.scaling("growth", found).caption)


def test_the_compiled_step_allocates_nothing_and_python_keeps_nothing(robot, few):
    found = scaling.measure(robot).memory

    assert found.compiled_count == 0
    assert found.kept_count == 0


def test_allocations_that_there_are_would_be_counted():
    from numba import njit

    @njit
    def allocate() -> int:
        return np.zeros(3).size

    allocate()

    assert scaling._compiled_allocations(lambda: [allocate() for _ in range(7)]) == 7


@pytest.mark.realtime
def test_bare_zenoh_is_timed_from_the_put_in_another_process_to_the_callback_in_this():
    found = whole_service.bare_puts(1400, 0.5)

    assert 0 < found.median_us <= found.high_us


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

    assert found.work.median_us == pytest.approx(710.0)
    assert found.beyond.median_us == pytest.approx(500.0)
    assert found.ipc.median_us == pytest.approx(180.0)
    assert found.zenoh.median_us == pytest.approx(200.0)
    parts_us = found.work.median_us + found.ipc.median_us + found.gateway_us
    assert found.whole.median_us == pytest.approx(parts_us + found.zenoh.median_us)


def test_messages_of_no_record_are_no_measurement(session):
    with pytest.raises(ServiceError, match="none of 0 messages"):
        whole_service.divide([], session.records[-20:], 120.0)


def test_the_page_shows_each_part_of_a_delivery_beside_bare_zenoh():
    times = [whole_service.Spread(float(n), 10.0 * n) for n in range(101, 106)]
    whole, work, beyond, ipc, zenoh_part = times
    delivery = whole_service.Delivery(whole, work, beyond, ipc, 333.0, zenoh_part)
    bare = whole_service.Spread(222.0, 2220.0)
    found = whole_service.Service(2.0, 190.0, 50.0, 12.0, delivery, bare, 1.7)

    console = Console(width=120)
    with console.capture() as captured:
        for table in tables.service("the service", found):
            console.print(table)

    for value in (*times, bare):
        assert f"{value.median_us:.0f} µs" in captured.get()
        assert f"{value.high_us:.0f} µs" in captured.get()
    assert "333 µs" in captured.get()
    assert "1.7 x" in captured.get()
