import json
import os
from pathlib import Path

from command_line import gaitd

from daemon.system.machine import checks as machine
from daemon.system.machine.finding import Finding, Grade


def put(root, path, text):
    file = root / path
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text + "\n")


def test_every_finding_that_is_not_good_says_what_to_do():
    found = machine.findings()

    assert all(finding.remedy for finding in found if finding.grade is not Grade.GOOD)
    assert len({finding.subject for finding in found}) == len(found)


def test_json_holds_every_finding():
    ran = gaitd("doctor", "--json")

    assert ran.code == 0
    found = json.loads(ran.out)
    assert {"subject", "found", "grade", "remedy"} == set(found[0])
    named = {row["subject"] for row in found}
    assert {"python", "kernel", "SocketCAN", "CAN interfaces", "swap", "idle states"} <= named


def test_the_table_names_every_subject():
    ran = gaitd("doctor")

    assert ran.code == 0
    assert "clock source" in ran.out
    assert "SCHED_FIFO" in ran.out


def test_a_broken_installation_is_the_only_reason_to_fail(monkeypatch):
    broken = Finding("packages", "numpy (no such file)", Grade.BROKEN, "install it again")
    monkeypatch.setattr("gaitd.doctor.findings", lambda: (broken,))
    assert gaitd("doctor").code == 1

    limited = Finding("kernel", "old", Grade.MISSING, "a newer one")
    monkeypatch.setattr("gaitd.doctor.findings", lambda: (limited,))
    assert gaitd("doctor").code == 0


def test_a_package_that_cannot_be_imported_is_named(monkeypatch):
    monkeypatch.setitem(machine.IMPORTS, "no-such-package", "no_such_package")

    finding = machine.packages()

    assert finding.grade is Grade.BROKEN
    assert "no-such-package" in finding.found


def test_looking_for_the_real_time_class_leaves_the_class_as_it_was():
    before = os.sched_getscheduler(0)

    machine.scheduling()

    assert os.sched_getscheduler(0) == before


def test_a_disk_that_is_nearly_full_is_pointed_out():
    assert machine.disk_room(Path("/var/lib/gaitd"), 100).grade is Grade.LIMITED
    assert machine.disk_room(Path("/var/lib/gaitd"), 10_000).grade is Grade.GOOD


def test_the_disk_is_that_of_the_state_directory_or_of_the_next_one_above(tmp_path):
    (tmp_path / "var").mkdir()
    assert machine.disk(tmp_path).found.endswith(f"at {tmp_path}/var")

    (tmp_path / "var/lib/gaitd").mkdir(parents=True)
    assert machine.disk(tmp_path).found.endswith(f"at {tmp_path}/var/lib/gaitd")


def test_a_machine_without_a_tmpfs_is_told_so(tmp_path):
    put(tmp_path, "proc/mounts", "/dev/sda1 / ext4 rw 0 0\ntmpfs /dev/shm tmpfs rw 0 0")
    assert machine.tmpfs(tmp_path).found == "/dev/shm"

    put(tmp_path, "proc/mounts", "/dev/sda1 / ext4 rw 0 0")
    assert machine.tmpfs(tmp_path).grade is Grade.LIMITED
