"""Directories that are missing, full, read-only or another user's: at the start, and later.

At the start it is a configuration error that names the directory, before anything is on the bus.
Later nothing waits for a disk: ring and notes have their room since the start.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from fault_observations import Watch
from gaitd_client import Event, Health
from gaitd_names import Cause, EventCode, Mode
from long_service import TIMEOUT_S, LongService
from processes import Service
from small_disk import fill

from gaitd_lab.processes import GAITD

CONFIGURATION_ERROR = 2
FULL = Path("/dev/full")
NOBODY = 65534
AS_A_USER = ("setpriv", "--bounding-set=-dac_override,-dac_read_search", "--inh-caps=-all")
"""Without the right of root to write what belongs to others."""
WALKED_CYCLES = 100
RING_AND_A_LITTLE = "24m"


def refused(service, part="core"):
    code, said = service.ran(part)
    assert code == CONFIGURATION_ERROR, said
    assert "Traceback" not in said
    assert said.startswith("configuration error: ")
    return said


# --- at the start -----------------------------------------------------------------------------


def test_a_runtime_directory_without_room_for_the_ring_is_refused_and_left_as_it_was(
    folder, small, fault_table
):
    run = small("run", "1m")

    said = refused(Service(folder))

    assert "paths.runtime" in said
    assert str(run) in said
    assert "No space left" in said
    assert not (run / "records.new").exists()
    fault_table.add(
        "runtime directory full", "start", "core", "exit 2, nothing sent", None, "said", "ended"
    )


def test_a_full_state_directory_is_refused_and_what_it_holds_is_kept(folder, small, fault_table):
    state = small("state", "1m")
    fill(state)

    said = refused(Service(folder))

    assert "paths.state" in said
    assert "No space left" in said
    fault_table.add(
        "state directory full", "start", "core", "exit 2, nothing sent", None, "said", "ended"
    )


@pytest.mark.parametrize(
    ("part", "name", "key"),
    [("core", "state", "paths.state"), ("core", "run", "paths.runtime")],
)
def test_a_directory_that_can_only_be_read_is_refused_by_its_key(
    folder, small, part, name, key, fault_table
):
    place = small(name, "1m", "ro")

    said = refused(Service(folder), part)

    assert key in said
    assert str(place) in said
    assert "Read-only" in said
    fault_table.add(
        f"{name} directory read-only", "start", part, "exit 2, nothing sent", None, "said", "ended"
    )


def test_a_directory_of_another_user_is_refused_by_its_key(folder, fault_table):
    if not shutil.which("setpriv"):
        pytest.skip("no setpriv, and root may write everywhere")
    service = Service(folder)
    (folder / "run").mkdir(mode=0o555)
    os.chown(folder / "run", NOBODY, NOBODY)

    ended = subprocess.run(
        [*AS_A_USER, sys.executable, *GAITD, "gateway", "--config", str(service.config)],
        capture_output=True,
        text=True,
        check=False,
    )

    assert ended.returncode == CONFIGURATION_ERROR, ended.stderr
    assert "paths.runtime" in ended.stderr
    assert "Permission denied" in ended.stderr
    assert "Traceback" not in ended.stderr
    fault_table.add(
        "runtime directory of another user",
        "start",
        "gateway",
        "exit 2, nothing sent",
        None,
        "said",
        "ended",
    )


def test_a_place_where_no_directory_can_be_made_is_refused_by_its_key(folder, fault_table):
    service = Service(folder)
    text = service.config.read_text()
    service.config.write_text(text.replace(f'"{folder}/run"', '"/proc/no/such/place"'))

    for part in ("core", "gateway"):
        assert "paths.runtime" in refused(service, part)
    fault_table.add(
        "directory that cannot be made",
        "start",
        "core, gateway",
        "exit 2, nothing sent",
        None,
        "said",
        "ended",
    )


def test_a_log_on_a_full_disk_keeps_no_core_from_running_and_from_ending_with_0(
    folder, fault_table
):
    service = Service(folder)
    command = [sys.executable, *GAITD, "core", "--config", str(service.config)]
    buffered = {name: one for name, one in os.environ.items() if name != "PYTHONUNBUFFERED"}
    with (
        Path("/dev/full").open("w") as full,
        subprocess.Popen(command, stderr=full, env=buffered) as core,
    ):
        try:
            service.until(lambda record: record.seq > 1, TIMEOUT_S)
        finally:
            core.terminate()

    assert core.returncode == 0
    fault_table.add(
        "log of the core on a full disk",
        "start and end",
        "none",
        "none: what it says is in its records, too",
        None,
        "none",
        "off",
    )


# --- in operation -----------------------------------------------------------------------------


@pytest.mark.thorough
def test_disks_that_fill_up_while_it_walks_change_nothing_but_one_event_and_the_end_is_orderly(
    folder, small, fault_table
):
    # A file of the black box has some megabytes: the state directory must hold one afterwards.
    places = [small("run", RING_AND_A_LITTLE), small("state", "24m")]
    service = LongService(folder)
    try:
        service.bring(Mode.GAIT)
        with Watch(service) as seen:
            for place in places:
                fill(place)
            first = service.newest().seq
            service.until(lambda record: record.seq > first + WALKED_CYCLES, TIMEOUT_S)
            records = seen.records_since()
            free = [shutil.disk_usage(place).free for place in places]
            answer = service.request("stop")
            stopped = service.until(lambda record: record.mode == Mode.FAULT, TIMEOUT_S)
        with service.client("observer") as trainer:
            items = []
            trainer.events().call(items.append)

            def told(code):
                return [
                    item.said for item in items if isinstance(item, Event) and item.code == code
                ]

            service.wait(lambda: told(EventCode.FILE_NOT_WRITTEN), TIMEOUT_S)
            (folder / "state" / "rubbish").unlink()
            service.bring(Mode.HOLD).stop()
            service.wait(lambda: told(EventCode.FILE_WRITTEN_AGAIN), TIMEOUT_S)
            failed = told(EventCode.FILE_NOT_WRITTEN)
            health = next(item for item in trainer.health() if isinstance(item, Health))
        service.parts["core"].terminate()
        code = service.parts["core"].wait(TIMEOUT_S)
        lived = service.runs("gateway")
    finally:
        service.end()

    assert free == [0, 0]
    assert all("No space left on device" in said for said in failed)
    assert len(failed) == len(set(failed))
    assert health.not_kept_count > 0
    assert {record.mode for record in records} == {Mode.GAIT}
    assert {record.verdict.cause for record in records} == {Cause.NONE}
    assert answer["outcome"] == "done"
    assert stopped.verdict.cause == Cause.STOP_REQUESTED
    assert code == 0
    assert lived
    assert "Traceback" not in service.log("core") + service.log("gateway")
    fault_table.add(
        "runtime and state directory fill up",
        "walking",
        "none: ring and notes have their room",
        f"none in {len(records)} cycles; a stop and the orderly end work",
        None,
        "none",
        "gait",
    )
