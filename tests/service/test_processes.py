"""A drive that falls silent, drives that vanish, and what a plain client hears. Real processes."""

import json
import subprocess
import sys

import pytest
from fault_observations import Watch
from gaitd_names import Cause, Mode
from long_service import TIMEOUT_S

from drives.signals import PowerState

SILENT_CYCLES = 3
SHOWN_CYCLES = 150


@pytest.fixture
def walking(long_service):
    return long_service.bring(Mode.GAIT)


def test_a_drive_that_falls_silent_never_takes_the_core_down(walking, fault_table):
    pid = walking.parts["core"].pid
    with Watch(walking) as seen:
        try:
            walking.inject("silent right/hip 600")
            stopped = walking.until(lambda record: record.mode == Mode.FAULT)
            walking.until(lambda record: record.seq >= stopped.seq + SHOWN_CYCLES)
            records = seen.records_since()
            status = walking.request("status")
        finally:
            walking.inject("clear silent right/hip")

    assert stopped.verdict.cause in {Cause.DRIVE_SILENT, Cause.HEARTBEAT_LOST}
    first = next(record for record in records if not record.mode.active)
    assert first.drives[0].sample_age_cycles > SILENT_CYCLES
    assert walking.parts["core"].pid == pid
    assert walking.runs("core")
    assert records[-1].drives[1].power_state == PowerState.QUICK_STOP_ACTIVE
    assert status["safety"]["verdict"]["cause"] in {"drive_silent", "heartbeat_lost"}
    fault_table.add(
        "one drive silent",
        "walking",
        "core: age of its samples",
        f"{first.drives[0].sample_age_cycles} cycles: NMT stop to it, S1 of the other",
        seen.moved(),
        stopped.verdict.cause.name,
        stopped.mode,
    )


def test_virtual_drives_that_vanish_leave_a_core_that_says_so_and_finds_them_again(
    walking, fault_table
):
    walking.kill("sim")
    stopped = walking.until(lambda record: record.mode in {Mode.FAULT, Mode.OFF})
    assert stopped.verdict.cause in {Cause.BUS_DOWN, Cause.DRIVE_SILENT}

    walking.start_drives()
    walking.wait(lambda: walking.request("reset")["outcome"] == "done", TIMEOUT_S)

    again = walking.until(lambda record: record.mode == Mode.READY, TIMEOUT_S)
    assert again.verdict.cause == Cause.NONE
    fault_table.add(
        "drives and bus gone at once",
        "walking",
        "core",
        "at once; found again after a reset",
        None,
        stopped.verdict.cause.name,
        stopped.mode,
    )


LISTENER = """
import json, sys, time, zenoh
config = zenoh.Config.from_json5(json.dumps({
    "mode": "client", "connect": {"endpoints": [sys.argv[1]]},
    "scouting": {"multicast": {"enabled": False}}}))
cycles = {}
newest = {}
def heard(sample):
    key = str(sample.key_expr)
    newest[key] = json.loads(sample.payload.to_bytes())
    cycles.setdefault(key, []).append(newest[key].get("cycle"))
with zenoh.open(config) as session:
    subscriber = session.declare_subscriber("gaitd/trainer/**", heard)
    while len(cycles.get("gaitd/trainer/right/friction", ())) < 100:
        time.sleep(0.02)
    schema = [json.loads(r.ok.payload.to_bytes())
              for r in session.get("gaitd/trainer/control/schema") if r.ok]
    subscriber.undeclare()
print(json.dumps({"cycles": cycles, "newest": newest, "schema": schema}))
"""


def test_a_plain_zenoh_client_hears_activity_and_friction_of_every_cycle_and_their_schema(walking):
    heard = subprocess.run(
        [sys.executable, "-I", "-c", LISTENER, f"tcp/127.0.0.1:{walking.zenoh_port}"],
        capture_output=True,
        text=True,
        timeout=90,
        check=True,
    )
    told = json.loads(heard.stdout)

    for name in ("activity", "friction", "estimate"):
        cycles = told["cycles"][f"gaitd/trainer/right/{name}"]
        assert cycles == sorted(set(cycles))
        # A busy computer drops some on the way: express data is not sent again.
        assert len(cycles) >= 0.9 * (cycles[-1] + 1 - cycles[0]) >= 80
    assert told["newest"]["gaitd/trainer/right/activity"]["core_boot_id"]
    text = json.dumps(told["schema"])
    for word in ("activity", "friction", "estimate", "safety", "events", "health", "drives"):
        assert word in text
