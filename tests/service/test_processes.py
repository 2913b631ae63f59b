"""Drives that vanish, and what a plain client hears. Real processes."""

import json
import subprocess
import sys

import pytest
from gaitd_names import Cause, Mode
from long_service import TIMEOUT_S


@pytest.fixture
def walking(long_service):
    return long_service.bring(Mode.GAIT)


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
