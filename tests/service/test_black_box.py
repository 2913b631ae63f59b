"""What is left on the disk of a stop, when processes die and when they do not. Real processes."""

import json
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from processes import MEMORY, Service

from daemon.kept_ring import FOLDER, kept_files
from daemon.record import Cause, Mode
from daemon.seam import ASIDE_NAME, RING_NAME

GAIT = ("mode", "gait", "--cadence", "0.25", "--amplitude", "1", "--duration", "60")
TRIES = 3


@pytest.fixture
def service():
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as folder:
        service = Service(Path(folder))
        try:
            yield service.start_all()
        finally:
            service.end()


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


def gaitd(*words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "gaitd", *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=90, check=False)


def state(service: Service) -> Path:
    return service.folder / "state"


def kept(service: Service, *causes: str):
    """The newest file that was kept for one of these, or also for one."""
    files = [file for file in kept_files(state(service) / FOLDER) if file.kept]
    found = [file for file in files if {file.kept.cause, *file.kept.also} & set(causes)]
    return found[-1] if found else None


def test_a_stop_by_the_hand_switch_is_kept_and_told_and_its_requests_are_in_the_log(walking):
    walking.inject("hand_switch_open right/hip")
    walking.until(lambda record: record.verdict.cause == Cause.HAND_SWITCH_OPEN)
    walking.wait(lambda: kept(walking, "hand_switch_open"), 20)
    file = kept(walking, "hand_switch_open")
    assert file.kept.active

    shown = gaitd("blackbox", "show", str(file.path))
    assert shown.returncode == 0, shown.stderr
    for words in ("hand_switch_open", "right/hip", "gait", "hand switch open", "quick stop active"):
        assert words in shown.stdout

    replayed = gaitd("replay", str(file.path), "--output", str(walking.folder / "out.csv"))
    assert replayed.returncode == 0, replayed.stderr
    assert file.header.core_boot_id in replayed.stdout
    assert "cause        hand_switch_open" in replayed.stdout

    listed = json.loads(walking.ask("blackbox", "--json").stdout)
    assert file.path.name in {Path(one["file"]).name for one in listed}

    said = walking.ask("blackbox", "requests", "--json").stdout.splitlines()
    lines = [json.loads(line) for line in said]
    answers = [(one["client"], one["name"], one["outcome"]) for one in lines if "outcome" in one]
    assert ("gaitd enable", "enable", "done") in answers
    assert ("gaitd mode", "mode", "done") in answers
    assert "hand_switch_open" in {one.get("cause") for one in lines}
    verify_finds_a_flipped_byte(walking)


def verify_finds_a_flipped_byte(service: Service):
    whole = service.ask("blackbox", "requests", "--verify")
    assert whole.returncode == 0, whole.stdout
    assert "holds" in whole.stdout
    copy = service.folder / "copy"
    copy.mkdir()
    data = bytearray((state(service) / "requests.jsonl").read_bytes())
    data[len(data) // 2] ^= 1
    (copy / "requests.jsonl").write_bytes(data)

    broken = gaitd("blackbox", "requests", "--verify", "--state", str(copy))

    assert broken.returncode == 1
    assert "requests.jsonl:" in broken.stdout


def test_a_core_that_is_killed_leaves_its_last_seconds_to_the_gateway(walking):
    walking.kill("core")

    walking.wait(lambda: kept(walking, "core_silent"), 20)

    file = kept(walking, "core_silent")
    assert file.kept.active
    assert file.kept.last_seq == walking.newest().seq
    assert gaitd("blackbox", "show", str(file.path)).returncode == 0


def test_when_both_are_killed_the_next_gateway_keeps_the_ring_that_it_finds(walking):
    walking.kill("gateway")
    walking.kill("core")
    last = walking.newest().seq
    assert kept(walking, "core_ended") is None

    walking.start("gateway")
    walking.wait(lambda: kept(walking, "core_ended"), 20)

    file = kept(walking, "core_ended")
    assert file.kept.active
    assert file.kept.last_seq == last
    assert (walking.folder / "run" / RING_NAME).exists()


def test_when_both_are_killed_and_the_core_is_back_first_its_ring_is_still_kept(walking):
    boot_id = walking.records() and json.loads(walking.ask("status", "--json").stdout)
    walking.kill("gateway")
    walking.kill("core")
    last = walking.newest().seq
    walking.start("core")
    walking.until(lambda record: record.seq < last, 30)
    assert (walking.folder / "run" / ASIDE_NAME).exists()

    walking.start("gateway")
    walking.wait(lambda: kept(walking, "core_ended"), 20)

    file = kept(walking, "core_ended")
    assert file.header.core_boot_id == boot_id["core_boot_id"]
    assert file.kept.last_seq == last
    walking.wait(lambda: not (walking.folder / "run" / ASIDE_NAME).exists(), 10)


def test_an_orderly_end_is_kept_before_the_gateway_is_gone(walking):
    walking.parts["core"].send_signal(signal.SIGTERM)
    assert walking.parts["core"].wait(15) == 0
    walking.parts["gateway"].send_signal(signal.SIGTERM)
    assert walking.parts["gateway"].wait(10) == 0

    assert kept(walking, "shutdown") is not None
    lines = (state(walking) / "requests.jsonl").read_text().splitlines()
    assert json.loads(lines[-1])["kind"] == "end"
