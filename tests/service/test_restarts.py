"""A gateway that ends and starts again, a second process beside the first, and what a kill leaves.

The rule of the design: a gateway that is silent for 300 ms makes the core stop and hold; sooner it
does not matter, whoever it is that speaks again.
"""

import socket

import pytest
from fault_observations import Watch
from gaitd_names import Cause, Mode
from long_service import TIMEOUT_S, WAITING_GATEWAY
from processes import Service

from daemon.ipc.transport import RING_NAME, RingReader
from drives.errors import BootFailure

CONFIGURATION_ERROR = 2
SILENCE_CYCLES = 30
AWAY_CYCLES, PERIOD_S = 20, 0.01
KNOWS_THE_CORE = f"[{Mode.GAIT}]".encode()
"""Part of the gateway's status for systemd once it has read a record."""
SHOWN_CYCLES = 50
TWO_TRIES_CYCLES = 200
TRIED_CYCLES = 8
"""Within SILENCE_CYCLES; a status comes every 0.5 s of the computer's time."""
NMT, SDO_REQUESTS = 0x000, range(0x600, 0x680)
TEMPERATURE_READ = bytes.fromhex("4001320100000000")
"""What the service that runs asks its drives in its cycles."""


@pytest.fixture
def walking(long_service):
    return long_service.bring(Mode.GAIT)


@pytest.fixture
def seen(walking):
    with Watch(walking) as watch:
        yield watch


def cycles_later(service, count=SHOWN_CYCLES):
    first = service.newest().seq
    service.until(lambda record: record.seq >= first + count)


def replace_gateway(service, folder):
    """Kill the gateway; another one has begun when AWAY_CYCLES have passed without any."""
    before = service.parts["gateway"]
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as supervisor:
        supervisor.bind(str(folder / "notify"))
        supervisor.settimeout(TIMEOUT_S)
        notified = {"NOTIFY_SOCKET": str(folder / "notify")}
        after = service.start("gateway", program=WAITING_GATEWAY, environment=notified)
        service.wait(lambda: service.log("gateway").endswith("gateway waits\n"), TIMEOUT_S)
        with service.held():
            before.kill()
            before.wait()
            service.run(AWAY_CYCLES * PERIOD_S)
            after.stdin.write(b"go\n")
            after.stdin.flush()
            assert supervisor.recv(4096) == b"READY=1"
            # It knows the core by a record, and sends its first state before it says so. On a busy
            # computer it may look for a record only after the first cycle.
            for _ in range(TRIED_CYCLES):
                service.run(PERIOD_S)
                if KNOWS_THE_CORE in supervisor.recv(4096):
                    break
            else:
                pytest.fail("the gateway has not read a record of the core")
        service.wait(lambda: service.request("status").get("safety", {}).get("valid"), TIMEOUT_S)


def test_a_gateway_that_is_back_within_300_ms_is_not_noticed_and_its_commands_count(
    walking, seen, tmp_path, fault_table
):
    replace_gateway(walking, tmp_path)
    cycles_later(walking)
    records = seen.records_since()
    silence_cycles = max(record.gateway_age_cycles for record in records)
    stop_count = records[-1].stop_count

    assert AWAY_CYCLES <= silence_cycles <= SILENCE_CYCLES
    assert {record.mode for record in records} == {Mode.GAIT}
    assert walking.request("stop")["outcome"] == "done"
    stopped = walking.until(lambda record: record.mode == Mode.FAULT)
    assert stopped.verdict.cause == Cause.STOP_REQUESTED
    assert stopped.stop_count == stop_count + 1
    fault_table.add(
        "gateway SIGKILL, another one at once",
        "walking",
        "none",
        f"none: silent for {silence_cycles} of {SILENCE_CYCLES} cycles",
        None,
        "none",
        "gait",
    )


@pytest.mark.parametrize("part", ["core", "gateway"])
def test_a_second_process_beside_the_first_is_refused_by_name_and_disturbs_nothing(
    long_service, part, fault_table
):
    walking = long_service.bring(Mode.GAIT)
    with Watch(walking) as seen:
        refusals = walking.newest().bus.foreign_master_count
        code, said = walking.ran(part)
        cycles_later(walking, 5)
        records = seen.records_since()
        seen.read_bus()

    assert code == CONFIGURATION_ERROR
    assert "paths.runtime" in said
    assert f"gaitd {part} with pid {walking.parts[part].pid} holds" in said
    assert f"{part}.lock" in said
    assert "Traceback" not in said
    assert {record.verdict.cause for record in records} == {Cause.NONE}
    assert max(record.gateway_age_cycles for record in records) <= SILENCE_CYCLES
    assert records[-1].bus.foreign_master_count == refusals
    assert not [one for one in seen.since(NMT, *SDO_REQUESTS) if one.data != TEMPERATURE_READ]
    assert walking.request("status")["safety"]["valid"]
    fault_table.add(
        f"a second {part} beside the first",
        "walking",
        f"the second {part}: the lock",
        "ended with exit 2 before it touched anything",
        None,
        "none",
        "gait",
    )


def begin_elsewhere(walking, folder):
    """A second core on the same bus, with directories of its own: what it told first."""
    stranger = Service(folder)
    stranger.config.write_text(
        stranger.config.read_text().replace(
            str(stranger.folder / "bus"), str(walking.folder / "bus")
        )
    )
    try:
        stranger.start("core")
        told = stranger.until(lambda record: record.verdict.cause != Cause.NONE, TIMEOUT_S)
        stranger.until(lambda record: record.seq > told.seq + TWO_TRIES_CYCLES)
    finally:
        stranger.end()
    return told


def test_a_second_core_with_directories_of_its_own_finds_the_other_master_and_sends_nothing(
    long_service, fault_table, tmp_path_factory
):
    with Watch(long_service.bring(Mode.GAIT)) as seen:
        told = begin_elsewhere(long_service, tmp_path_factory.mktemp("stranger"))
        records = seen.records_since()
        seen.read_bus()

    assert told.mode == Mode.OFF
    assert told.verdict.said.startswith(str(BootFailure.FOREIGN_MASTER))
    assert {record.verdict.cause for record in records} == {Cause.NONE}
    assert not [one for one in seen.since(NMT, *SDO_REQUESTS) if one.data != TEMPERATURE_READ]
    fault_table.add(
        "a second core, elsewhere, on the same bus",
        "walking",
        "the second core: another master",
        "heard before it sent anything; tries again every second",
        None,
        "none",
        "gait",
    )


def test_a_runtime_directory_that_disappears_stops_the_machine_and_ends_no_process(
    walking, seen, fault_table
):
    ring = RingReader(walking.folder / "run" / RING_NAME)  # as a black box that was opened before
    seen.begin()
    run = walking.folder / "run"
    taken = run.rename(run.with_name("taken"))
    try:
        walking.wait(lambda: ring.since(ring.newest_seq() - 1)[-1].mode == Mode.FAULT, TIMEOUT_S)
        status = walking.request("status")
    finally:
        taken.rename(run)
    records = [record for record in ring.since(0) if record.sync_mono_ns >= seen.begun_ns]
    ring.close()

    assert walking.runs("core")
    assert walking.runs("gateway")
    stopped = next(record for record in records if not record.mode.active)
    assert stopped.verdict.cause == Cause.GATEWAY_SILENT
    assert not status["safety"]["valid"]
    fault_table.add(
        "runtime directory taken away",
        "walking",
        "core: age of the gateway's word; gateway: no records",
        f"{stopped.gateway_age_cycles} cycles: S2",
        seen.moved(),
        stopped.verdict.cause.name,
        "fault, held",
    )
