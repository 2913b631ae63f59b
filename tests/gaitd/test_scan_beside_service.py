"""`gaitd scan` and `gaitd drive` on the bus of a service at work: nothing of it changes."""

from contextlib import closing

import pytest
from drive_files import CYCLE, HIP_LIMITS
from gaitd_names import Mode, RequestKind
from msgspec.structs import replace
from second_station import SecondStation, finished
from sessions import changed_configs, new_session

from daemon.ipc.record import BusRecord, ModeRequest
from drives.bringup.configurator import Configurator
from drives.bringup.plan import plan
from drives.canopen.sniffer import BusSniffer, SniffedBus
from drives.service.dump import read_objects, readable
from drives.service.eds import load_eds
from drives.service.inventory import FindingKind, inventory_of
from drives.service.parameters import Command, ParameterRefusedError, check_bus, check_drive
from drives.service.scan import survey
from drives.service.stations import Expected

MBIT = 1_000_000


def what_it_did(session):
    """Its records but for what they count of the bus, on which there is more now."""
    return [replace(record, bus=BusRecord()) for record in session.records]


NOISE = (
    ("position_noise_rad = 5.0e-5", "position_noise_rad = 0.0"),
    ("position_noise_m = 2.0e-5", "position_noise_m = 0.0"),
    ("current_noise_a = 0.01", "current_noise_a = 0.0"),
)
"""Each look at a virtual drive draws new noise; without it, a look changes nothing at all."""


def walking(configs):
    session = new_session(configs).enable()
    gait = ModeRequest(Mode.GAIT, cadence_hz=0.25, amplitude_ratio=1.0, duration_s=600.0)
    session.request(RequestKind.MODE, gait)
    session.run(1.0)
    return session


def expected(session):
    return Expected(session.settings.drives, session.settings.trainer.cycle.master_node_id)


@pytest.fixture(scope="module")
def configs(tmp_path_factory):
    changes = (("plant.toml", old, new) for old, new in NOISE)
    return changed_configs(tmp_path_factory.mktemp("noiseless"), *changes)


@pytest.fixture(scope="module")
def warm_walking(configs):
    return walking(configs)


@pytest.fixture(scope="module")
def alone(configs):
    """The same, which walks on for longer than it takes to look at it, unseen."""
    session = walking(configs)
    session.run(4.0)
    return session


def assert_unchanged(looked_at, alone):
    ours, theirs = what_it_did(looked_at), what_it_did(alone)
    sent = looked_at.bus.sent
    assert len(ours) < len(theirs)
    assert looked_at.record.mode == Mode.GAIT
    assert ours == theirs[: len(ours)]
    assert sent == alone.bus.sent[: len(sent)]


def test_a_scan_of_a_walking_machine_finds_it_and_changes_no_record(warm_walking, alone):
    station = SecondStation(warm_walking)

    found = inventory_of(finished(survey(station, station.clock, MBIT)), expected(warm_walking))

    assert [s.power_state for s in found.stations] == ["operation enabled"] * 2
    assert [s.nmt_state for s in found.stations] == ["operational"] * 2
    assert [f.kind for f in found.findings] == [FindingKind.SERVICE]
    assert_unchanged(warm_walking, alone)


def test_a_dump_of_a_walking_drive_changes_no_record(warm_walking, alone):
    station = SecondStation(warm_walking)
    dictionary = load_eds(warm_walking.settings.drives[0].eds, 5)

    port = Configurator(station, station.clock)
    entries = finished(read_objects(5, readable(dictionary), port, as_filled=True))

    assert {(entry.index, entry.sub): entry.value for entry in entries}[0x6061, 0] == 10
    assert_unchanged(warm_walking, alone)


def test_nothing_is_stored_or_restored_beside_a_service_or_in_a_drive_that_has_power():
    session = new_session().enable()
    station = SecondStation(session)
    sniffer = BusSniffer()
    with closing(SniffedBus(station, station.clock, sniffer)) as bus:
        bus.receive_until(station.clock.now_ns() + 1, station.clock)
        session.run(0.1)
        bus.drain()
    steps = plan(session.settings.drives[0], HIP_LIMITS, CYCLE)

    with pytest.raises(ParameterRefusedError, match="the bus is in use"):
        check_bus(sniffer, 1)
    for keeping in Command:
        with pytest.raises(ParameterRefusedError, match="operation enabled"):
            check_drive(steps, keeping, Configurator(station, station.clock))
    assert all(frame.data[0] == 0x40 for frame in station.sent)
