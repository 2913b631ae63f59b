"""What is left on the disk of a stop, when processes die and when they do not. Real processes."""

import json
from pathlib import Path

import pytest
from command_line import gaitd
from gaitd_names import Cause, Mode
from processes import Service

from daemon.ipc.ring_clip import FOLDER, clip_files
from daemon.ipc.transport import PREVIOUS_RING_NAME, RING_NAME


@pytest.fixture
def walking(long_service):
    return long_service.bring(Mode.GAIT)


def state(service: Service) -> Path:
    return service.folder / "state"


def kept(service: Service, boot_id: str, *causes: str):
    """The newest file of this core that was kept for one of these, or also for one."""
    files = [file for file in clip_files(state(service) / FOLDER) if file.kept]
    files = [file for file in files if file.core_boot_id == boot_id]
    found = [file for file in files if {file.kept.cause, *file.kept.also} & set(causes)]
    return found[-1] if found else None


def test_a_stop_by_the_hand_switch_is_kept_and_told_and_its_requests_are_in_the_log(walking):
    boot_id = walking.boot_id()
    walking.inject("hand_switch_open right/hip")
    stopped = walking.until(lambda record: record.verdict.cause == Cause.HAND_SWITCH_OPEN)
    walking.inject("clear hand_switch_open right/hip")
    walking.wait(lambda: kept(walking, boot_id, "hand_switch_open"), 60)
    file = kept(walking, boot_id, "hand_switch_open")
    assert file.kept.active
    assert file.kept.first_seq < file.kept.stop_seq <= stopped.seq < file.kept.last_seq

    shown = gaitd("blackbox", "show", file.path)
    assert shown.code == 0, shown.err
    for words in ("hand_switch_open", "right/hip", "gait", "hand switch open", "quick stop active"):
        assert words in shown.out

    replayed = gaitd("replay", file.path, "--output", walking.folder / "out.csv")
    assert replayed.code == 0, replayed.err
    assert file.core_boot_id in replayed.out
    assert "cause        hand_switch_open" in replayed.out

    listed = json.loads(walking.ask("blackbox", "--json").out)
    assert file.path.name in {Path(one["file"]).name for one in listed}

    assert walking.request("enable", client="another display")["outcome"] == "refused"
    assert walking.request("stop", client="a carer")["outcome"] == "done"
    walking.wait(lambda: "a carer" in (state(walking) / "requests.jsonl").read_text(), 20)
    asked = walking.ask("blackbox", "requests", "--json", "--last", "100000")
    said = asked.out.splitlines()
    lines = [json.loads(line) for line in said]
    answers = [(one["client"], one["name"], one["outcome"]) for one in lines if "outcome" in one]
    assert ("tester", "mode", "done") in answers
    assert ("another display", "enable", "refused") in answers
    assert ("a carer", "stop", "done") in answers
    assert "hand_switch_open" in {one.get("cause") for one in lines}


def test_when_both_are_killed_and_the_core_is_back_first_its_ring_is_still_kept(
    walking, fault_table
):
    boot_id, run = walking.boot_id(), walking.folder / "run"
    walking.kill("gateway")
    walking.kill("core")
    last = walking.newest().seq
    left = {path.name for path in run.iterdir()}
    assert {"core.sock", "gateway.sock", RING_NAME, "core.lock", "gateway.lock"} <= left
    (run / "records.new").write_bytes(b"half a ring")

    walking.start("core")
    walking.wait(lambda: walking.boot_id() not in {boot_id, ""}, 90)

    assert (run / PREVIOUS_RING_NAME).exists()
    assert not (run / "records.new").exists()
    walking.start_gateway()
    walking.wait(lambda: kept(walking, boot_id, "core_ended"), 60)
    assert kept(walking, boot_id, "core_ended").kept.last_seq == last
    walking.wait(lambda: not (run / PREVIOUS_RING_NAME).exists(), 60)
    fault_table.add(
        "core and gateway SIGKILL",
        "walking",
        "the next core and gateway",
        "left-over sockets, locks and rings are taken over; the ring is kept",
        None,
        "none",
        "ready",
    )
