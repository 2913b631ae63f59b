"""Programs beside each other on one simulated bus, as people start them."""

import contextlib
import ctypes
import json
import os
import re
import signal
import subprocess
import sys
import time

import pytest
from command_line import gaitd
from gaitd_names import Mode
from processes import Service

from simtime.clock import PageClock
from simtime.processes import IN_A_DEBUGGER, process_state

TIMEOUT_S = 60
PTRACE_DETACH, PTRACE_SEIZE, PTRACE_INTERRUPT = 17, 0x4206, 0x4207


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    """Virtual drives and a core, as fast as they can."""
    made = Service(tmp_path_factory.mktemp("programs"))
    try:
        made.start_drives()
        made.start("core")
        made.until(lambda record: record.mode == Mode.READY, TIMEOUT_S)
        yield made
    finally:
        made.end()


def test_a_scan_and_a_logger_of_python_can_work_beside_the_service(service, tmp_path):
    log = tmp_path / "bus.log"
    words = ["-m", "can.logger", "-i", "gaitd", "-c", str(service.folder / "bus"), "-f", str(log)]
    begun = service.newest().seq
    with subprocess.Popen([sys.executable, *words], stdout=subprocess.DEVNULL) as logger:
        service.wait(lambda: log.exists() and log.stat().st_size > 0, TIMEOUT_S)
        ended = gaitd("scan", "--config", service.config, "--json")
        logger.send_signal(signal.SIGINT)
        logger.wait(10)

    found = json.loads(ended.out)
    assert ended.code == 0, ended.out
    assert [one["nmt_state"] for one in found["stations"]] == ["operational"] * 2
    assert [one["kind"] for one in found["findings"]] == ["service"]
    heard = set(re.findall(r" ([0-9A-F]{3})#", log.read_text()))
    assert {"080", "185", "186", "585", "605"} <= heard
    assert {record.mode for record in service.records(begun)} == {Mode.READY}


@contextlib.contextmanager
def in_a_debugger(pid):
    """The process stopped as by a breakpoint: state t."""
    libc = ctypes.CDLL(None, use_errno=True)
    libc.ptrace.argtypes = [ctypes.c_long, ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p]
    if libc.ptrace(PTRACE_SEIZE, pid, None, None) != 0:
        pytest.skip(f"ptrace is forbidden here: {os.strerror(ctypes.get_errno())}")
    libc.ptrace(PTRACE_INTERRUPT, pid, None, None)
    os.waitpid(pid, 0)
    try:
        yield
    finally:
        libc.ptrace(PTRACE_DETACH, pid, None, None)


def test_time_waits_for_both_of_two_cores_and_for_one_that_is_left(service, tmp_path):
    second = Service(tmp_path)
    second.config.write_text(
        second.config.read_text().replace(str(tmp_path / "bus"), str(service.folder / "bus"))
    )
    clock = PageClock(service.folder / "bus")
    try:
        core = second.start("core")
        second.wait(second.newest, TIMEOUT_S)
        assert service.inject("seats") == "ok: core core"

        with in_a_debugger(core.pid):
            assert process_state(core.pid) == IN_A_DEBUGGER
            stands_ns = clock.now_ns()
            time.sleep(0.5)
            assert clock.now_ns() - stands_ns <= 10_000_000  # the wait it was in is a cycle's
        second.until(lambda record: record.sync_mono_ns > stands_ns + 50_000_000)

        killed_ns, alone = clock.now_ns(), service.newest().seq
        second.kill("core")
        service.until(lambda record: record.sync_mono_ns > killed_ns + 500_000_000, 5)
        after = service.records(alone)
        assert {(one.timing.lateness_ns, one.time_is_simulated) for one in after} == {(0, True)}
    finally:
        second.end()
