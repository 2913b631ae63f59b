"""`gaitd commission` and `gaitd reference` as people run them, through real processes."""

import json
import subprocess
import sys
import tempfile
from operator import itemgetter
from pathlib import Path
from subprocess import PIPE

import can
import pytest
from gaitd_names import Mode
from processes import Service
from sessions import changed_configs

from analysis.acceptance.record import Judgement, read
from daemon.ipc.state_file import NAME
from gaitd_lab.processes import GAITD, memory_folder

SLIDE_SDO, SLIDE_ANSWER = 0x606, 0x586
NO_RAMP = bytes.fromhex("2b5e600000000000")
"""Download of 0 to object 605Eh of node 6."""


def empty_machine(trainer, plant):
    """A running service of the empty machine, whose signs are to be proven."""
    with tempfile.TemporaryDirectory(dir=memory_folder()) as name:
        folder = Path(name)
        configs = changed_configs(
            folder,
            (trainer, '"robot.toml"', '"robot_empty.toml"'),
            (plant, '"robot.toml"', '"robot_empty.toml"'),
            (trainer, 'signs = "assumed"', 'signs = "proven"'),
            # Each of three gaits is announced, and ramped up, in a fourth of the time.
            (trainer, "announce_s = 3.0", "announce_s = 0.5"),
            (trainer, "ramp_strides = 2", "ramp_strides = 1"),
        )
        service = Service(folder, configs, trainer)
        try:
            service.start_all()
            service.until(lambda record: record.mode == Mode.READY, 90)
            service.wait(lambda: service.request("status").get("safety", {}).get("valid"), 90)
            yield service
        finally:
            service.end()


@pytest.fixture(scope="module")
def service():
    yield from empty_machine("demo.toml", "plant.toml")


@pytest.fixture
def two_legged():
    yield from empty_machine("two_legs.toml", "plant_two_legs.toml")


def test_an_axis_that_does_not_exist_is_refused_with_those_that_do(service):
    refused = service.ask("reference", "left/knee")

    assert refused.code == 1
    assert "right/hip, right/slide" in refused.out


def test_a_sign_is_proven_kept_and_found_again_by_the_next_start(service):
    refused = service.ask("enable")
    assert refused.code == 1
    assert "sign is not proven" in refused.out

    proven = service.ask("commission", "hip", "--witnessed")
    assert proven.code == 0, proven.out + proven.err
    assert "the thigh is first raised" in proven.err
    assert "moves with its torque: pushed forth" in proven.out
    service.until(lambda record: record.drives[0].sign_proven)

    killed = service.boot_id()
    service.kill("core")
    service.start("core")
    service.wait(lambda: service.boot_id() not in {killed, ""}, 40)
    up = service.until(lambda record: record.mode in {Mode.READY, Mode.FAULT}, 40)
    if up.mode == Mode.FAULT:  # the drives have missed their master
        service.wait(lambda: service.ask("reset").code == 0, 20)
    again = service.until(lambda record: record.mode == Mode.READY and record.drives[0].fresh, 40)

    service.wait(lambda: service.request("status").get("safety", {}).get("valid"), 20)
    assert again.drives[0].sign_proven
    assert not again.drives[1].sign_proven
    pages = map(json.loads, (service.folder / "state" / NAME).read_text().splitlines())
    kept = max(pages, key=itemgetter("number"))["state"]
    assert kept["axes"]["right/hip"]["proof"]["serial_number"] == 305_000_005


@pytest.mark.thorough
def test_acceptance_of_two_legs_is_written_while_the_operator_does_what_is_asked(
    two_legged, tmp_path
):
    words = ("commission", "--report", str(tmp_path), "--yes", "--witnessed", "--json")
    gait = ("--cadence", "0.5")
    command = [sys.executable, *GAITD, *words, *gait, "--config", str(two_legged.config)]
    inputs = {
        "NOW let go": "hand_switch_open *",
        "Hold the hand switch": "clear hand_switch_open *",
        "NOW press": "sto_open *",
        "Release the emergency stop": "clear sto_open *",
    }
    said = []

    with subprocess.Popen(command, stdout=PIPE, stderr=PIPE, text=True) as asked:
        for line in asked.stderr:
            said.append(line)
            for words, order in inputs.items():
                if line.startswith(words):
                    two_legged.inject(order)
        drives = json.loads(asked.stdout.read())

    assert asked.returncode == 0, (drives, "".join(said))
    assert [drive["drive"] for drive in drives] == [
        *("right/hip", "right/slide", "left/hip", "left/slide")
    ]
    assert all(drive["failed"] == 0 and drive["passed"] > 60 for drive in drives)
    for name in ("right_slide", "left_hip"):
        record = read(tmp_path / f"{name}.json")
        assert [stop.category for stop in record.stops] == ["S2", "S1", "S0"]
        assert record.core_boot_id == two_legged.boot_id()


def test_acceptance_reads_the_drives_of_a_running_service_and_moves_nothing_if_one_is_wrong(
    service, tmp_path
):
    """Its motions are those of tests/gaitd/commissioning, and at night those of the test above."""
    with service.listener() as bus:
        bus.send(can.Message(arbitration_id=SLIDE_SDO, data=NO_RAMP, is_extended_id=False))
        assert next(one for one in iter(bus.recv, None) if one.arbitration_id == SLIDE_ANSWER)

    asked = service.ask("commission", "--report", str(tmp_path), "--yes", "--json")

    assert asked.code == 1, asked.err
    records = [read(tmp_path / f"right_{axis}.json") for axis in ("hip", "slide")]
    failed = [
        (one.drive, one.values["place"], one.values["found"])
        for record in records
        for one in record.findings
        if one.judgement is Judgement.FAILED
    ]
    assert failed == [("right/slide", "605Eh:00", "0")]
    record = records[1]
    assert record.core_boot_id == service.boot_id()
    assert not record.stops
    assert service.newest().mode == Mode.READY
