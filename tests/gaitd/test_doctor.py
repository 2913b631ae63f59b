import json
import os

import pytest
import typer
from typer.testing import CliRunner

from gaitd import machine
from gaitd.doctor import doctor
from gaitd.machine import Finding, Grade


def application() -> typer.Typer:
    app = typer.Typer()
    app.command()(doctor)
    return app


def put(root, path, text):
    file = root / path
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text + "\n")


def test_every_finding_that_is_not_good_says_what_to_do():
    found = machine.findings()

    assert all(finding.remedy for finding in found if finding.grade is not Grade.GOOD)
    assert len({finding.subject for finding in found}) == len(found)


def test_json_holds_every_finding():
    ran = CliRunner().invoke(application(), ["--json"])

    assert ran.exit_code == 0
    found = json.loads(ran.stdout)
    assert {"subject", "found", "grade", "remedy"} == set(found[0])
    assert {"python", "kernel", "SocketCAN", "CAN interfaces"} <= {row["subject"] for row in found}


def test_the_table_names_every_subject():
    ran = CliRunner().invoke(application(), [])

    assert ran.exit_code == 0
    assert "clock source" in ran.stdout
    assert "SCHED_FIFO" in ran.stdout


def test_a_broken_installation_is_the_only_reason_to_fail(monkeypatch):
    broken = Finding("packages", "numpy (no such file)", Grade.BROKEN, "install it again")
    monkeypatch.setattr("gaitd.doctor.findings", lambda: (broken,))
    assert CliRunner().invoke(application(), []).exit_code == 1

    limited = Finding("kernel", "old", Grade.MISSING, "a newer one")
    monkeypatch.setattr("gaitd.doctor.findings", lambda: (limited,))
    assert CliRunner().invoke(application(), []).exit_code == 0


def test_a_package_that_cannot_be_imported_is_named(monkeypatch):
    monkeypatch.setitem(machine.IMPORTS, "no-such-package", "no_such_package")

    finding = machine.packages()

    assert finding.grade is Grade.BROKEN
    assert "no-such-package" in finding.found


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("sys/kernel/realtime", "1"),
        ("proc/version", "Linux version 6.1.0-rt SMP PREEMPT_RT Debian"),
    ],
)
def test_a_real_time_kernel_is_recognised(tmp_path, path, text):
    put(tmp_path, path, text)

    assert machine.kernel(tmp_path).grade is Grade.GOOD


def test_a_kernel_without_real_time_is_limited(tmp_path):
    put(tmp_path, "proc/version", "Linux version 6.1.0 SMP PREEMPT_DYNAMIC Debian")

    assert machine.kernel(tmp_path).grade is Grade.LIMITED


@pytest.mark.parametrize(("source", "grade"), [("tsc", Grade.GOOD), ("hpet", Grade.LIMITED)])
def test_a_slow_clock_source_is_pointed_out(tmp_path, source, grade):
    put(tmp_path, "sys/devices/system/clocksource/clocksource0/current_clocksource", source)

    assert machine.clock_source(tmp_path).grade is grade


def test_a_governor_that_saves_power_is_pointed_out(tmp_path):
    for cpu, name in enumerate(["performance", "powersave"]):
        put(tmp_path, f"sys/devices/system/cpu/cpu{cpu}/cpufreq/scaling_governor", name)

    finding = machine.governor(tmp_path)

    assert finding.grade is Grade.LIMITED
    assert finding.found == "performance, powersave"


def test_a_can_interface_with_a_short_queue_or_that_is_down_gets_its_command(tmp_path):
    for name, queue, flags in (("can0", "10", "0x40080"), ("can1", "1000", "0x400c1")):
        put(tmp_path, f"sys/class/net/{name}/type", "280")
        put(tmp_path, f"sys/class/net/{name}/tx_queue_len", queue)
        put(tmp_path, f"sys/class/net/{name}/flags", flags)
    put(tmp_path, "sys/class/net/lo/type", "772")

    finding = machine.can_interfaces(tmp_path)

    assert finding.found == "can0 down, queue of 10; can1 up, queue of 1000"
    assert finding.remedy == "ip link set can0 up; ip link set can0 txqueuelen 128"


def test_looking_for_the_real_time_class_leaves_the_class_as_it_was():
    before = os.sched_getscheduler(0)

    machine.scheduling()

    assert os.sched_getscheduler(0) == before


def test_real_time_that_is_switched_off_is_pointed_out(tmp_path):
    put(tmp_path, "proc/sys/kernel/sched_rt_runtime_us", "0")

    assert machine.throttling(tmp_path).grade is Grade.LIMITED


def test_a_machine_without_a_tmpfs_is_told_so(tmp_path):
    put(tmp_path, "proc/mounts", "/dev/sda1 / ext4 rw 0 0\ntmpfs /dev/shm tmpfs rw 0 0")
    assert machine.tmpfs(tmp_path).found == "/dev/shm"

    put(tmp_path, "proc/mounts", "/dev/sda1 / ext4 rw 0 0")
    assert machine.tmpfs(tmp_path).grade is Grade.LIMITED
