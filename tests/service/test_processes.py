"""What a process that dies or hangs does to the other one, and to the leg. Real processes."""

import json
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
from processes import MEMORY, Service, emergencies

from daemon.record import Cause, Mode
from drives.signals import PowerState

DETECTION_S = 0.1
SILENCE_S = 0.3
GAIT = ("mode", "gait", "--cadence", "0.25", "--amplitude", "1", "--duration", "60")
PATIENCE_S = 0.4
"""Of a busy machine, on top of what the configuration says."""


@pytest.fixture
def service():
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as folder:
        service = Service(Path(folder))
        try:
            yield service.start_all()
        finally:
            service.end()


TRIES = 3
"""A machine that stalls for 100 ms makes the drives stop, rightly; here it is only in the way."""


@pytest.fixture
def walking(service):
    for _ in range(TRIES):
        service.until(lambda record: record.mode in {Mode.READY, Mode.FAULT}, 40)
        if service.newest().mode == Mode.FAULT:
            service.wait(lambda: service.ask("reset").returncode == 0, 20)
        if service.ask("enable").returncode != 0 or service.ask(*GAIT).returncode != 0:
            continue
        walked = service.until(
            lambda record: record.gait_phase > 0.1 or record.mode == Mode.FAULT, 30
        )
        if walked.mode == Mode.GAIT:
            return service
    raise AssertionError(f"never walked: {service.newest().verdict}")


def test_a_core_that_is_killed_leaves_drives_that_stop_by_themselves(walking):
    with walking.listener() as bus:
        walking.kill("core")
        found = emergencies(bus, within_s=2, count=2)
    time.sleep(1.5)
    walking.start("core")
    again = walking.until(
        lambda record: record.mode in {Mode.READY, Mode.FAULT} and record.seq > 1, 30
    )

    assert {node: codes[0][1] for node, codes in found.items()} in (
        {5: 0x8130, 6: 0x8130},
        {5: 0x8250, 6: 0x8250},
    )
    assert max(codes[0][0] for codes in found.values()) < DETECTION_S + PATIENCE_S
    assert not again.mode.active
    assert PowerState.OPERATION_ENABLED not in {drive.power_state for drive in again.drives}


def test_a_core_that_starts_again_waits_for_a_request_and_then_works(walking):
    walking.kill("core")
    time.sleep(1.5)
    walking.start("core")
    found = walking.until(lambda record: record.mode in {Mode.READY, Mode.FAULT}, 30)

    if found.mode == Mode.FAULT:
        walking.wait(lambda: walking.ask("reset").returncode == 0, 20)
    ready = walking.until(lambda record: record.mode == Mode.READY, 20)

    assert {drive.power_state for drive in ready.drives} == {PowerState.SWITCH_ON_DISABLED}
    assert walking.ask("enable").returncode == 0


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_gateway_that_dies_or_hangs_makes_the_core_stop_and_hold(walking, number):
    begun_ns = time.monotonic_ns()
    walking.kill("gateway", number)
    walking.until(lambda record: record.mode == Mode.FAULT, 10)
    time.sleep(0.5)

    records = walking.records()
    stopped = next(r for r in records if r.sync_mono_ns > begun_ns and not r.mode.active)
    newest = records[-1]
    assert stopped.verdict.cause == Cause.GATEWAY_SILENT
    assert (stopped.sync_mono_ns - begun_ns) * 1e-9 < SILENCE_S + PATIENCE_S
    assert {drive.power_state for drive in newest.drives} == {PowerState.OPERATION_ENABLED}
    assert all(abs(drive.velocity_si or 0) < 0.05 for drive in newest.drives)
    assert walking.parts["core"].poll() is None


def test_a_drive_that_falls_silent_never_takes_the_core_down(walking):
    pid = walking.parts["core"].pid
    walking.inject("silent right/hip")
    stopped = walking.until(lambda record: record.mode == Mode.FAULT, 10)
    time.sleep(2)

    assert stopped.verdict.cause in {Cause.DRIVE_SILENT, Cause.HEARTBEAT_LOST}
    assert walking.parts["core"].poll() is None
    assert walking.parts["core"].pid == pid
    assert walking.newest().drives[1].power_state == PowerState.QUICK_STOP_ACTIVE
    status = walking.ask("status", "--json")
    assert "does not answer" in status.stdout or "DRIVE_SILENT" in status.stdout.upper()


def test_sigterm_stops_first_then_switches_off_and_ends_with_0(walking):
    walking.kill("core", signal.SIGTERM)
    assert walking.parts["core"].wait(10) == 0

    newest = walking.records()[-1]
    truth = walking.truth()[-1]
    assert newest.verdict.cause == Cause.SHUTDOWN
    assert {drive.power_state for drive in newest.drives} == {PowerState.SWITCH_ON_DISABLED}
    assert abs(float(truth["hip_velocity_rad_per_s"])) < 1.0


def test_virtual_drives_that_vanish_leave_a_core_that_says_so_and_finds_them_again(walking):
    walking.kill("sim")
    walking.until(lambda record: record.mode == Mode.FAULT, 10)
    assert walking.newest().verdict.cause in {Cause.BUS_DOWN, Cause.DRIVE_SILENT}

    walking.start_drives()
    walking.wait(lambda: walking.ask("reset").returncode == 0, 30)

    assert walking.until(lambda record: record.mode == Mode.READY, 20).verdict.cause == Cause.NONE


LISTENER = """
import json, sys, time, zenoh
config = zenoh.Config.from_json5(json.dumps({
    "mode": "client", "connect": {"endpoints": [sys.argv[1]]},
    "scouting": {"multicast": {"enabled": False}}}))
counts = {}
newest = {}
def heard(sample):
    key = str(sample.key_expr)
    counts[key] = counts.get(key, 0) + 1
    newest[key] = json.loads(sample.payload.to_bytes())
with zenoh.open(config) as session:
    subscriber = session.declare_subscriber("gaitd/trainer/**", heard)
    time.sleep(0.5)
    counts.clear()
    time.sleep(3)
    seen = dict(counts)
    schema = [json.loads(r.ok.payload.to_bytes())
              for r in session.get("gaitd/trainer/control/schema") if r.ok]
    subscriber.undeclare()
print(json.dumps({"counts": seen, "newest": newest, "schema": schema}))
"""


def test_a_plain_zenoh_client_hears_activity_and_friction_at_100_hz_and_their_schema(walking):
    heard = subprocess.run(
        [sys.executable, "-I", "-c", LISTENER, f"tcp/127.0.0.1:{walking.zenoh_port}"],
        capture_output=True,
        text=True,
        timeout=30,
        check=True,
    )
    told = json.loads(heard.stdout)

    for name in ("activity", "friction", "estimate"):
        assert told["counts"][f"gaitd/trainer/right/{name}"] == pytest.approx(300, rel=0.1)
    assert told["newest"]["gaitd/trainer/right/activity"]["core_boot_id"]
    text = json.dumps(told["schema"])
    for word in ("activity", "friction", "estimate", "safety", "events", "health", "drives"):
        assert word in text
